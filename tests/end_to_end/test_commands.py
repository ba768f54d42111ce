"""The commands as a user runs them, on simulated instruments: real pyusb, real pyserial, real processes.

A whole capture, those that are killed and interrupted, and who locks others out are processes of their own; the rest
runs in this one, which has imported what the commands need.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import daylit as front_door

CAPTURE = ("capture", "Try Out", "--simulate", "room", "--size", "small", "--rate", "4")
RESUME = ("capture", "--rate", "4", "--resume")
"""The session has the world, its size, the cameras, and that there was no meter."""
FEW_STOPS = ("--stops", "1/15,1/60,1/250")
ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def started(*arguments: str, cwd: Path) -> Iterator[subprocess.Popen[str]]:
    """Start a command; kill it if it still runs when the block ends."""
    with subprocess.Popen(
        [sys.executable, "-m", "daylit", *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def daylit(*arguments: str, cwd: Path, expect: int = 0) -> list[dict[str, Any]]:
    """Run a command and return its standard output as JSON objects."""
    with started(*arguments, cwd=cwd) as process:
        out, err = process.communicate(timeout=300)
    assert process.returncode == expect, f"exit {process.returncode}\n{out}\n{err}"
    return [json.loads(line) for line in out.splitlines()]


class Here:
    """Commands in this process, begun in a folder of their own."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *arguments: str, expect: int = 0) -> list[dict[str, Any]]:
        """Run a command and return its standard output as JSON objects."""
        self._capsys.readouterr()
        code = front_door.main(list(arguments))
        said = self._capsys.readouterr()
        assert (code or 0) == expect, f"exit {code}\n{said.out}\n{said.err}"
        return [json.loads(line) for line in said.out.splitlines()]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    monkeypatch.chdir(tmp_path)
    return Here(capsys)


def test_a_capture_is_whole_and_verifies(here: Here, tmp_path: Path) -> None:
    events = daylit(*CAPTURE, *FEW_STOPS, "--address", "7 Elm Street", cwd=tmp_path)
    summary = events[-1]
    assert json.loads((tmp_path / summary["session"] / "session.json").read_text())["site"]["name"] == "7 Elm Street"
    assert summary["ok"]
    assert summary["frames"] == 6
    kinds = [e["event"] for e in events[:-1]]
    assert kinds[0] == "started"
    assert kinds[-1] == "finished"
    assert kinds.count("saved") == 6
    assert kinds.count("reading") == 2
    assert any("ASSUMED" in w for w in summary["warnings"]), "the assumed meter dialect is stated in the session"
    (report,) = here("verify", "--look", "--json", summary["session"])
    assert report["ok"], report
    manifest = json.loads((tmp_path / summary["session"] / "session.json").read_text())
    assert manifest["simulated"]
    assert manifest["target"] is not None
    assert {d["role"] for d in manifest["devices"]} == {"indoor", "outdoor", "meter"}
    assert all(f["exif_s"] == pytest.approx(f["asked_s"], rel=0.1) for f in manifest["frames"])


def test_one_flipped_bit_is_found(here: Here, tmp_path: Path) -> None:
    session = here(*CAPTURE, "--stops", "1/60", "--only", "indoor", "--no-meter")[-1]["session"]
    (frame,) = (tmp_path / session / "indoor").iterdir()
    data = bytearray(frame.read_bytes())
    data[len(data) // 2] ^= 1
    frame.chmod(0o644)
    frame.write_bytes(data)
    (report,) = here("verify", "--json", session, expect=4)
    assert not report["ok"]
    assert frame.name in json.dumps(report["problems"])


def test_killed_in_the_middle_then_resumed(here: Here, tmp_path: Path) -> None:
    acknowledged = []
    with started(*CAPTURE, "--stops", "1/4,1/15,1/60,1/250", "--no-meter", cwd=tmp_path) as process:
        assert process.stdout is not None
        for line in process.stdout:
            event = json.loads(line)
            if event.get("event") == "saved":
                acknowledged.append(event["file"])
            if len(acknowledged) >= 3:
                process.send_signal(signal.SIGKILL)
                break
    (session,) = (tmp_path / "sessions").iterdir()
    digests = {name: (session / name).read_bytes() for name in acknowledged}
    summary = here(*RESUME, str(session))[-1]
    assert summary["ok"], summary
    assert summary["frames"] == 8
    assert all((session / name).read_bytes() == data for name, data in digests.items())
    (report,) = here("verify", "--json", str(session))
    assert report["ok"]


def test_ctrl_c_ends_after_the_pair_and_says_how_to_go_on(tmp_path: Path) -> None:
    last: dict[str, Any] = {}
    asked = False
    with started(*CAPTURE, "--stops", "1/4,1/15,1/60,1/250", "--no-meter", cwd=tmp_path) as process:
        assert process.stdout is not None
        for line in process.stdout:
            last = json.loads(line)
            if last.get("event") == "saved" and not asked:
                asked = True
                process.send_signal(signal.SIGINT)
        assert process.wait(120) == 130
    assert last["status"] == "partial"
    assert last["missing"]
    assert last["frames"] >= 2, "what was exposed is kept"


def test_adaptive_says_what_it_left_out(here: Here) -> None:
    world = "uniform:100"
    events = here(
        "capture",
        "x",
        "--simulate",
        world,
        "--size",
        "small",
        "--bracket",
        "adaptive",
        "--only",
        "indoor",
        "--no-meter",
        "--rate",
        "4",
    )
    skipped = [e for e in events if e.get("event") == "skipped"]
    assert skipped
    assert all("already nothing" in e["reason"] for e in skipped)
    assert events[-1]["ok"]
    assert events[-1]["frames"] + events[-1]["skipped"] == 9


def test_dry_run_touches_nothing(here: Here, tmp_path: Path) -> None:
    (plan,) = here("capture", "x", "--simulate", "room", "--dry-run", "--json")
    assert len(plan["rows"]) == 9
    assert plan["total_s"] > plan["exposures_s"] > 5.3
    assert not list(tmp_path.iterdir())


def test_typed_reading_stands_for_the_meter(here: Here, tmp_path: Path) -> None:
    summary = here(*CAPTURE, "--stops", "1/60", "--only", "indoor", "--reading", "34.63")[-1]
    manifest = json.loads((tmp_path / summary["session"] / "session.json").read_text())
    (reading,) = manifest["readings"]
    assert (reading["status"], reading["luminance_cd_m2"]) == ("typed", 34.63)


def test_doctor_passes_on_simulated_instruments(here: Here) -> None:
    (answer,) = here("doctor", "--simulate", "room", "--json")
    assert answer["ok"], answer
    assert any("ASSUMED" in c["text"] for c in answer["checks"])
    assert {"indoor", "outdoor", "meter", "disk", "libusb", "renderer"} <= {c["name"] for c in answer["checks"]}


def test_conform_reports_each_check(here: Here) -> None:
    (conform,) = here("conform", "--simulate", "room", "--only", "meter", "--json")
    assert conform["ok"], conform
    assert conform["simulated"]
    assert len(conform["outcomes"]) == 3


def test_two_stations_on_one_session_exclude_each_other(here: Here, tmp_path: Path) -> None:
    session = here(*CAPTURE, "--stops", "1/60", "--only", "indoor", "--no-meter")[-1]["session"]
    holder = (
        "import sys, time; from pathlib import Path; from station.session.store import SessionStore;"
        "store = SessionStore.open(Path(sys.argv[1]), writable=True); print('held', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", holder, session],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        (refused,) = here(*RESUME, session, "--json", expect=4)
        assert refused["error"]["code"] == "SES-002"
        process.kill()
    assert here(*RESUME, session)[-1]["ok"], "a killed holder leaves no lock behind"
