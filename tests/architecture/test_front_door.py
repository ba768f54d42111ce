"""The `daylit` command as a user meets it first."""

from __future__ import annotations

import errno
import importlib
import json
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from PIL import Image

import daylit
from processing.relighting import model_pictures
from station.session import durable

ENTRIES = {name: entry for section in daylit.COMMANDS.values() for name, entry in section.items()}


@pytest.mark.parametrize("name", sorted(ENTRIES))
def test_every_command_loads_has_help_an_example_and_json(name: str) -> None:
    command = getattr(importlib.import_module(ENTRIES[name].module), ENTRIES[name].attribute)
    assert isinstance(command, click.Command)
    leaves = command.commands.values() if isinstance(command, click.Group) else [command]
    for leaf in leaves:
        assert "xample" in (leaf.help or ""), f"{leaf.name}: the help has no example"
        assert "--json" in {o for p in leaf.params for o in p.opts}, f"{leaf.name}: no --json"
        assert "None]" not in leaf.get_help(click.Context(leaf)), f"{leaf.name}: a range without ends"


def test_help_lists_all_commands_and_imports_none_of_them() -> None:
    code = (
        "import sys, daylit; daylit.main(['--help']);"
        "heavy = {'numpy', 'pydantic', 'cv2', 'serial', 'usb', 'rich', 'PIL'} & set(sys.modules);"
        "assert not heavy, heavy; assert not [m for m in sys.modules if m.startswith('station')]"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    for name in ENTRIES:
        assert name in done.stdout


def test_unknown_command_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["nonsense"]) == 2
    assert "nonsense" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["proces", "x"], "did you mean process or"),
        (["captur", "x"], "did you mean capture"),
        (["rig", "calibrat"], "calibrate"),
        (["process", "x", "--qualty", "draft"], "--quality"),
        (["export", "x", "--no-lable"], "--no-label"),
    ],
)
def test_a_word_that_is_nearly_one_of_ours_is_recognised(
    words: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert daylit.main(words) == 2
    assert meant in capsys.readouterr().err


def test_a_word_that_is_like_nothing_suggests_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["xyzzy"]) == 2
    assert "did you mean" not in capsys.readouterr().err


def test_errors_are_json_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["verify", "no-such-session", "--json"]) == 4
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert answer["error"]["code"].startswith("SES-")


def test_internal_error_leaves_a_report_without_personal_paths(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_args: object, **_kwargs: object) -> None:
        raise RuntimeError("a fault of our own")

    monkeypatch.setattr(daylit.cli, "main", broken)
    assert daylit.main(["demo"]) == 70
    result = capsys.readouterr().err
    path = result.split("paths removed): ")[1].split(". Please")[0]
    with open(path, encoding="utf-8") as file:
        report = file.read()
    assert "a fault of our own" in report
    assert str(__import__("pathlib").Path.home()) not in report


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["furniture", "export", "armchair/classic", "--into"], "full.glb"),
        (["furniture", "show", "armchair/classic", "--into"], "full.png"),
    ],
)
def test_a_disk_that_is_full_is_said_to_be(
    words: list[str], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python's own writing names no file in its error; and no file that is cut off is left."""

    def fsync(fd: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(durable.os_calls, "fsync", fsync)
    monkeypatch.setattr(model_pictures, "two_sides", lambda _: Image.new("RGB", (8, 8)))  # what is drawn is no matter
    assert daylit.main([*words, str(tmp_path / name), "--json"]) == 6
    found = json.loads(capsys.readouterr().out)["error"]
    assert (found["code"], found["where"]) == ("RES-001", str(tmp_path / name))
    assert not list(tmp_path.iterdir())


def test_a_full_disk_that_no_command_expects_is_no_internal_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(daylit.cli, "main", full)
    assert daylit.main(["view", "--json"]) == 6
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "RES-001"


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (["furniture", "export", "armchair/classic", "--into"], "x.glb"),
        pytest.param(["furniture", "show", "armchair/classic", "--into"], "x.png", marks=pytest.mark.long),
        (["doctor", "--write-rig"], "x.toml"),
        (["import", "nothing.zip", "--into"], "x"),
    ],
)
def test_what_cannot_be_written_is_the_computers_fault_not_ours(
    words: list[str], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 6 with the file's name, whichever command it is; no crash report."""
    (tmp_path / "file").write_text("no folder")
    assert daylit.main([*words, str(tmp_path / "file" / name), "--json"]) == 6
    found = json.loads(capsys.readouterr().out)["error"]
    assert (found["code"], found["where"]) == ("RES-002", str(tmp_path / "file" / name))
