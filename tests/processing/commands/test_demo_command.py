"""`daylit demo`: what it refuses before anything is made, and a real photograph on its way in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.commands import demo as command
from processing.ground import kernels
from station.commands.views import Rendering
from station.session.store import load_manifest
from tests.station.session.sessions import complete_session


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    rgb = np.random.default_rng(1).integers(60, 200, (64, 128, 3), dtype=np.uint8)
    Image.fromarray(rgb).save(tmp_path / "bedroom.png")
    return tmp_path / "bedroom.png"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--world", "room", "--room", "{photo}"], "cannot be combined"),
        (["--sky", "{photo}"], "--sky needs --room"),
        (["--room", "{photo}", "--sky", "{photo}"], "is a photograph"),
        (["--room", "{photo}", "--size", "half"], "needs no capture"),
        (["--room", "{photo}", "--capture-only"], "needs no capture"),
    ],
)
def test_what_cannot_be_is_refused_first(
    arguments: list[str], words: str, photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [argument.format(photo=photo) for argument in arguments]
    assert daylit.main(["demo", *filled, "--into", str(tmp_path / "demo")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "demo").exists()


def test_the_help_names_the_scene_that_is_taken_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    daylit.main(["demo", "--help"])
    assert f"{command.GENERATED} (the default)" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("asked", "expected"),
    [
        ([], ("bedroom-7-clear", "full", "bedroom-7-clear", 4.0)),
        (["--quick"], ("bedroom-7-clear", "quarter", "bedroom-7-clear", 8.0)),
        (["--world", "room:7", "--size", "half"], ("room:7", "half", "room-7", 4.0)),
    ],
)
def test_what_is_seen_by_itself_is_the_sunny_bedroom(
    asked: list[str], expected: tuple[str, str, str, float], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[str, str, str, float]] = []

    def captured(world: str, size: str, room: str, into: Path, *, rate: float, **_: object) -> object:
        seen.append((world, size, room, rate))
        path = complete_session(into)
        return path, load_manifest(path), True

    monkeypatch.setattr(command, "_captured", captured)
    assert daylit.main(["demo", "--capture-only", *asked, "--into", str(tmp_path / "demo")]) == 0
    assert seen == [expected]


def test_a_photograph_becomes_a_session_and_the_end_says_where_to_look(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from processing.running.requests import RunRequest
    from processing.running.runner import process

    asked: list[dict[str, str]] = []

    def until_calibrate(session: Path, options: dict[str, str], *_: object, **__: object) -> object:
        asked.append(options)
        return process(session, RunRequest(until="calibrate"))

    monkeypatch.setattr(command, "_processed", until_calibrate)
    into = tmp_path / "demo"
    assert daylit.main(["demo", "--room", str(photo), "--into", str(into), "--set", "bedroom"]) == 0
    (session,) = into.iterdir()
    assert load_manifest(session).panorama is not None
    assert asked == [{"set": "bedroom"}]
    result = capsys.readouterr().out
    assert "peak memory" in result
    assert f"report:  {session / 'stages' / 'report' / 'index.html'}" in result.splitlines()
    assert "daylit models get" in result.splitlines()[-1]


def test_what_is_waited_for_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "calibration.json").write_text("{}")  # there is nothing to capture
    with command._beside(tmp_path, "sessions", waited_for=False):
        pass
    assert "waiting" not in capsys.readouterr().err
    with command._beside(tmp_path, "sessions", waited_for=True):
        pass
    assert f"waiting for the rig's sessions, captured in parallel ({tmp_path}/sessions.log)" in capsys.readouterr().err


def test_beside_the_capture_the_rigs_sessions_are_captured_and_kernels_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the processes beside do, here; a rig that is calibrated is left alone."""
    made: list[object] = []
    monkeypatch.setattr(command, "_rig_session", lambda folder, name, **_: made.append((folder, name)))
    monkeypatch.setattr(kernels, "load_kernels", lambda: made.append("kernels"))
    command._meanwhile("kernels", tmp_path)
    command._meanwhile("sessions", tmp_path)
    (tmp_path / "calibration.json").write_text("{}")
    command._meanwhile("sessions", tmp_path)
    assert made == ["kernels", (tmp_path, "chart"), (tmp_path, "sphere")]


def test_what_is_rendered_says_how_long_it_takes_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # what makes rich take it for a terminal
    moment_s = iter(range(1000))
    with Rendering() as rendering:
        assert rendering.bars is not None
        rendering.bars.get_time = lambda: float(next(moment_s))
        for step in range(4):
            rendering("light", step, 100)
        (task,) = rendering.bars.tasks
        (words,) = {column.render(task).plain for column in rendering.bars.columns if "Remaining" in str(type(column))}
    assert words not in ("", "-:--:--")
