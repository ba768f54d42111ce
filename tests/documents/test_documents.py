"""README and docs keep their word: commands and options exist, code runs or at least names what there is."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import numpy as np
import pytest
from PIL import Image

import daylit

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.M | re.S)
_FLAG = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]+")
_NOT_OF_THE_FIELD = re.compile(r"\b(?:told|tells?|telling)\b", re.I)
MAX_README_LINES = 130
MAX_FILES_IN_A_FOLDER = 20
OF_OTHERS = {"--name", "--quick", "--long", "--device", "--memory-limit", "--minutes"}
"""Options of other programs that pages mention: git, pytest, the benchmark runner, Dask, training."""
PROGRAMS = ("gio ", "git ", "pytest ", "dask ")
RUN = {
    "README.md": "a session of one panorama",
    "docs/guides/arranging.md": "a plan",
    "docs/guides/furniture.md": "nothing",
}
"""Pages whose Python code is run here, and what it is given; others' needs minutes, or is an example of a stage."""


def page_name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> Iterator[str]:
    for found, text in _BLOCK.findall(page.read_text("utf-8")):
        if found == language:
            yield text


def command_lines() -> Iterator[tuple[str, str]]:
    """Yield (page, line) of each `daylit` command line in a block of commands."""
    for page in PAGES:
        for language in ("", "console", "sh", "bash"):
            for text in blocks(page, language):
                for line in text.replace("\\\n", " ").splitlines():
                    bare = line.strip().removeprefix("$ ").removeprefix(".venv/bin/")
                    if bare.startswith("daylit "):
                        yield page_name(page), bare


def leaf(words: list[str]) -> tuple[click.Command, list[str], click.Context]:
    """Return the command that the words name, and what is left of them."""
    context = click.Context(daylit.cli, info_name="daylit")
    command: click.Command = daylit.cli
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(context, words[0])
        assert found is not None, f"there is no command {words[0]!r}"
        context = click.Context(found, info_name=words[0], parent=context)
        command, words = found, words[1:]
    return command, words, context


LINES = sorted(set(command_lines()))


def test_there_are_commands_to_check() -> None:
    assert len([page for page, _ in LINES if page == "README.md"]) >= 10


@pytest.mark.parametrize(("page", "line"), LINES, ids=[f"{page}: {line[:60]}" for page, line in LINES])
def test_command_lines_can_be_given(page: str, line: str) -> None:
    words = shlex.split(line.replace("…", "x"), comments=True)[1:]
    command, rest, context = leaf(words)
    assert not isinstance(command, click.Group) or not rest, f"{page}: {line}"
    # Only parsed: unknown options and left-over words raise; nothing is opened or run.
    _, left, _ = command.make_parser(context).parse_args([word for word in rest if word not in ("-h", "--help")])
    assert not left, f"{page}: {line}: too much: {left}"


def all_flags() -> set[str]:
    """Return every option of every command."""
    found: set[str] = {"--help", "--version"}
    waiting: list[tuple[click.Command, click.Context]] = [(daylit.cli, click.Context(daylit.cli))]
    while waiting:
        command, context = waiting.pop()
        found |= {name for p in command.get_params(context) for name in (*p.opts, *p.secondary_opts)}
        if isinstance(command, click.Group):
            for name in command.list_commands(context):
                inner = command.get_command(context, name)
                assert inner is not None
                waiting.append((inner, click.Context(inner, parent=context)))
    return found


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_options_that_pages_name_exist(page: Path) -> None:
    known = all_flags() | OF_OTHERS
    spans = [span for span in re.findall(r"`([^`\n]+)`", page.read_text("utf-8")) if not span.startswith(PROGRAMS)]
    named = {flag for span in spans for flag in _FLAG.findall(span)}
    assert named <= known, sorted(named - known)


CODE = [(page_name(page), k, text) for page in PAGES for k, text in enumerate(blocks(page, "python"))]


@pytest.mark.parametrize(("page", "number", "text"), CODE, ids=[f"{page} {number}" for page, number, _ in CODE])
def test_code_is_python_and_imports_what_there_is(page: str, number: int, text: str) -> None:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(node.module or "")
            missing = [name.name for name in node.names if not hasattr(module, name.name)]
            assert not missing, f"{page}, block {number}: {node.module} has no {missing}"


def test_all_pages_whose_code_is_run_have_code() -> None:
    assert set(RUN) <= {page for page, _, _ in CODE}


@pytest.mark.parametrize(
    ("page", "text"), [(page, text) for page, _, text in CODE if page in RUN], ids=[c[0] for c in CODE if c[0] in RUN]
)
def test_code_runs(page: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(text, page, "exec"), given(page, tmp_path))  # our own documents
    assert capsys.readouterr().err == ""


def given(page: str, folder: Path) -> dict[str, object]:
    """Return the names that a page's code expects."""
    if RUN[page] == "a plan":
        plan = folder / "plan.json"
        corners = "[[0, 0], [4, 0], [4, 3.5], [0, 3.5]]"
        door = '{"kind": "door", "edge": 0, "t0": 0.3, "t1": 1.2}'
        plan.write_text(f'{{"polygon": {corners}, "openings": [{door}]}}')
        return {"path": plan, "folder": folder}
    if RUN[page] == "nothing":
        return {}
    from processing.running.panorama_session import panorama_session

    rgb = np.random.default_rng(1).integers(60, 200, (64, 128, 3), dtype=np.uint8)
    Image.fromarray(rgb).save(folder / "room.png")
    return {"session": panorama_session(folder / "room.png", folder / "sessions")}


def test_the_readme_is_no_manual() -> None:
    assert len((ROOT / "README.md").read_text("utf-8").splitlines()) <= MAX_README_LINES


def test_the_index_names_every_page() -> None:
    index = ROOT / "docs" / "index.md"
    linked = {target.partition("#")[0] for target in re.findall(r"\]\(([^)\s]+)\)", index.read_text("utf-8"))}
    linked |= {f"measurements/{name}" for name in re.findall(r"\]\((\w+\.md)", _measurements_index())}
    pages = {page.relative_to(index.parent).as_posix() for page in index.parent.rglob("*.md")} - {"index.md"}
    assert pages <= linked, sorted(pages - linked)


def _measurements_index() -> str:
    return (ROOT / "docs" / "measurements" / "index.md").read_text("utf-8")


def test_folders_of_documents_are_small() -> None:
    folders = [ROOT / "docs", *(f for f in (ROOT / "docs").rglob("*") if f.is_dir() and f.name != "images")]
    counts = {folder.name: sum(f.is_file() for f in folder.iterdir()) for folder in folders}
    assert max(counts.values()) <= MAX_FILES_IN_A_FOLDER, counts


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=page_name)
def test_words_are_those_of_the_field(page: Path) -> None:
    """Rooms and values are estimated, detected, measured, reported; pages do not 'tell'."""
    prose = re.sub(r"`[^`\n]*`", "", _BLOCK.sub("", page.read_text("utf-8")))
    assert not _NOT_OF_THE_FIELD.findall(prose)


def test_links_lead_somewhere() -> None:
    wrong = []
    for page in PAGES:
        text = page.read_text("utf-8")
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            path, _, anchor = target.partition("#")
            if "://" in target or target.startswith("mailto:"):
                continue
            place = page if not path else (page.parent / path)
            if not place.exists():
                wrong.append(f"{page_name(page)}: {target}")
            elif anchor and place.suffix == ".md" and anchor not in anchors(place):
                wrong.append(f"{page_name(page)}: {target}: no such heading")
    assert not wrong, "\n".join(wrong)


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as code hosts make them."""
    found = set()
    for heading in re.findall(r"^#+ +(.+?)\s*$", page.read_text("utf-8"), re.M):
        kept = "".join(c for c in heading.lower() if c.isalnum() or c in " -_")
        found.add(kept.replace(" ", "-"))
    return found
