"""Ceilings on size, and docstrings on what is public: the exception lists are empty and stay so."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FILES = [p for folder in ("drivers", "mocks", "station", "processing") for p in sorted((ROOT / folder).rglob("*.py"))]
FILES.append(ROOT / "daylit.py")
MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 40
MOST_UNDER = 200
FORBIDDEN_NAMES = {"utils.py", "helpers.py", "misc.py", "common.py", "manager.py"}


def function_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without its docstring."""
    body = node.body
    if ast.get_docstring(node) and len(body) > 1:
        return (node.end_lineno or node.lineno) - body[1].lineno + 2
    return (node.end_lineno or node.lineno) - node.lineno + 1


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_file_is_calm(path: Path) -> None:
    text = path.read_text("utf-8")
    assert path.name not in FORBIDDEN_NAMES
    assert text.count("\n") <= MAX_FILE_LINES, "split this file"
    tree = ast.parse(text)
    long = [
        f"{node.name}: {function_lines(node)} lines"
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and function_lines(node) > MAX_FUNCTION_LINES
    ]
    assert not long, long
    assert path.name == "__init__.py" or ast.get_docstring(tree), "a module says what it is for"


def test_most_files_are_short() -> None:
    counts = sorted(p.read_text("utf-8").count("\n") for p in FILES)
    assert counts[int(0.75 * len(counts))] <= MOST_UNDER * 1.3, "three quarters of the files stay near 200 lines"


def test_nothing_names_the_workplace() -> None:
    telltale = re.compile(r"(?<![\w/.])/(work|root)/|(?<![\w])brief\.md")
    wrong = []
    for path in (*FILES, *(ROOT / "tests").rglob("*.py"), *(ROOT / "docs").rglob("*.md"), ROOT / "README.md"):
        if path.exists() and path != Path(__file__) and telltale.search(path.read_text("utf-8")):
            wrong.append(path.relative_to(ROOT).as_posix())
    assert not wrong, wrong
