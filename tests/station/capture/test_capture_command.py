"""What the commands refuse, and what they say: without instruments."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import daylit
from drivers.clock import SteadyClock, SystemClock
from station.capture import preflight, rig
from station.capture.bracket import typical_cost
from station.capture.conform import Outcome
from station.capture.preflight import Check, Level
from station.capture.rig import Rig
from station.capture.rig_file import PAPER_INDOOR, PAPER_OUTDOOR, RigFile
from station.commands import capture as commands
from station.commands import instruments
from station.commands.views import printable


@pytest.mark.parametrize(
    "arguments",
    [
        ["kitchen", "--resume", "S"],
        ["--resume", "S", "--stops", "1,2"],
        ["--resume", "S", "--bracket", "adaptive"],
        ["--resume", "S", "--target", "0,0"],
        ["--resume", "S", "--dry-run"],
        ["--resume", "S", "--address", "7 Elm Street"],
        ["--resume", "S", "--into", "elsewhere"],
        ["kitchen", "--rooms", "rooms.txt"],
        ["kitchen", "--size", "half"],
        ["kitchen", "--simulate", "recorded:t.jsonl", "--size", "half"],
        ["kitchen", "--simulate", "recorded:t.jsonl", "--rig", "rig.toml"],
        ["kitchen", "--simulate", "recorded:t.jsonl", "--record", "again.jsonl"],
    ],
)
def test_options_that_would_do_nothing_are_refused(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert daylit.main(["capture", *arguments, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["code"] == "USE-001"


def test_an_example_rig_is_answered_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rig.toml"
    assert daylit.main(["doctor", "--write-rig", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"ok": True, "file": str(path)}


@pytest.mark.parametrize(
    ("only", "missing"),
    [((), set()), (("indoor",), {"outdoor"}), (("outdoor",), {"indoor"}), (("indoor", "outdoor"), set())],
)
def test_only_may_name_both_cameras(only: tuple[str, ...], missing: set[str]) -> None:
    """--only indoor --only outdoor took the outdoor camera alone."""
    (option,) = (o for o in commands.capture.params if o.name == "only")
    assert option.type_cast_value(None, only) == only  # type: ignore[arg-type]
    assert set(commands._changes({"only": only, "no_meter": False})) == missing


def test_conform_without_the_instrument_has_not_passed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text("camera_height_m = 1.5\n")
    assert daylit.main(["conform", "--rig", str(rig), "--only", "meter", "--json"]) == 2
    assert "no meter" in capsys.readouterr().out


def test_a_room_with_a_name_beyond_all_bounds_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["import", "x" * 600, "--indoor", str(tmp_path), "--into", str(tmp_path / "s"), "--json"]
    assert daylit.main(arguments) == 2
    assert "too long" in capsys.readouterr().out


def test_raw_files_are_in_the_estimate() -> None:
    for table in (PAPER_INDOOR, PAPER_OUTDOOR):
        plain, raw = typical_cost(table.kind), typical_cost(table.kind, keep_raw=True)
        assert raw.frame_bytes > plain.frame_bytes + 20e6
        assert raw.transfer_s > plain.transfer_s


def test_no_control_character_of_a_device_reaches_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["capture", "--rig", "\x1b[2Jno.toml", "--dry-run"]) == 2
    assert "\x1b[2J" not in capsys.readouterr().err
    assert printable("EOS\x1b[2J\n5D") == "EOS?[2J?5D"


def test_doctor_has_colours_and_no_control_character_of_a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [
        Check(Level.OK, "python", "3.11"),
        Check(Level.FAIL, "camera", "\x1b[2Jhas no name", "give it\x07one"),
    ]
    monkeypatch.setattr(preflight, "check_computer", lambda _folder: iter(found))
    monkeypatch.setattr(preflight, "list_instruments", lambda: iter(()))
    plain = CliRunner().invoke(instruments.doctor, [], standalone_mode=False)
    assert plain.output.splitlines() == [
        "ok    python: 3.11",
        "FAIL  camera: ?[2Jhas no name",
        "      what to do: give it?one",
    ]
    assert plain.return_value == 1
    assert (
        "\x1b[32mok  \x1b[0m  python"
        in CliRunner().invoke(instruments.doctor, [], color=True, standalone_mode=False).output
    )


def test_conform_has_no_control_character_of_a_device(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = Outcome("theta_z1", "says_who_it_is", passed=True, detail="RICOH \x1b[2JTHETA")
    monkeypatch.setattr(instruments, "_run", lambda *_args, **_options: iter([outcome]))
    monkeypatch.setattr(
        rig, "open_named_rig", lambda *_args, **_options: Rig(RigFile(), {}, None, SteadyClock(SystemClock()))
    )
    said = CliRunner().invoke(instruments.conform, [], color=True, standalone_mode=False).output
    assert said == "\x1b[32mok  \x1b[0m  theta_z1 says who it is: RICOH ?[2JTHETA\n"
