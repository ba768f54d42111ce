"""`daylit demo` from nothing to its last line, then README's commands as written, in order, on what it made.

Before that, on a copy of its session: what `--keep` leaves. `make torture` starts the demo as a user does, with its
processes beside it and the rig at its size, and makes a draft of halved pictures beside one of whole ones; `make test`
does all in this process, the rig at an eighth of full size, the draft halved at once, all light with few rays.
"""

from __future__ import annotations

import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import click
import cv2
import numpy as np
import pytest

import daylit
from processing.commands import demo as demo_command
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage
from processing.pipeline import STAGES
from processing.running.runner import RESULTS
from processing.stages import upright
from processing.stages.upright import in_size
from tests.conftest import LONG
from tests.once import all_anew

ROOT = Path(__file__).resolve().parents[2]
pytestmark = [pytest.mark.timeout(3600), pytest.mark.usefixtures("few_rays")]
SESSION = "sessions/2023-05-19T1554Z_coda-320"
"""README's session: here it is the demo's, under this name."""
NEEDED = {
    "doctor --rig": "connects to instruments (tests/end_to_end/test_commands.py: on simulated ones)",
    "capture coda-320": "needs instruments (the same)",
    "capture --resume": "needs a capture that was cut off (the same)",
    "studio": "serves until it is stopped (tests/studio)",
    "demo": "done before, at an eighth of the size",
    "capture x": "renders a generated room for minutes (tests/mocks)",
    "simulate rooms": "renders twenty generated rooms for an hour (tests/station/simulate)",
    "models get": "fetches a file from the net",
    "process --panorama": "a whole run more (tests/processing/running)",
    "import desk": "needs the bracket of a fisheye (tests/processing/commands/test_one_side.py)",
    "process SESSION --eye-lens": "the same",
}
"""README's commands that are not run here, by how they begin, and why."""
HALF_PX = 210
"""Half as wide as the demo's small panorama."""
OF_THE_PLACE = ("north is unknown", "the panorama's heading is not recorded")
"""Warnings that the simple room must have: it is in no place. The default room is, but takes minutes to render."""


@dataclass
class Made:
    """What the demo made, and said."""

    folder: Path
    session: Path
    lines: list[str]


def run(*words: str, cwd: Path) -> str:
    """Run a command as a user would; a browser that is asked for opens nothing."""
    done = subprocess.run(
        [sys.executable, "-m", "daylit", *words],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), "BROWSER": shutil.which("true") or "true"},
        capture_output=True,
        text=True,
        timeout=1700,
        check=False,
    )
    assert done.returncode == 0, f"daylit {shlex.join(words)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@contextmanager
def done_before(folder: Path, task: str, *, waited_for: bool) -> Iterator[None]:
    """The rig's sessions, captured here instead of beside; kernels are compiled as they are needed."""
    if waited_for:
        folder.mkdir(parents=True)
        with redirect_stdout(io.StringIO()):
            demo_command._meanwhile(task, folder)
    yield


def run_here(*words: str, cwd: Path) -> str:
    """Run a command in this process, which has imported what it needs."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.chdir(cwd)
        patch.setattr(demo_command, "_beside", done_before)
        patch.setattr(demo_command, "RIG_SIZE", "small")
        patch.setattr(demo_command, "QUICK_RATE", demo_command.RATE)  # a busy machine lost frames at twice that
        patch.setattr(upright, "LEAST_DRAFT_PX", HALF_PX)
        assert daylit.main(list(words)) == 0, (out.getvalue(), err.getvalue())
    return click.unstyle(out.getvalue())


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory, few_rays: None) -> Made:
    """The whole of it, staging too, in draft quality with pictures of an eighth the size."""
    folder = tmp_path_factory.mktemp("demo")
    words = ("demo", "--quick", "--world", "room", "--size", "small")
    lines = (run if LONG else run_here)(*words, cwd=folder).splitlines()
    (session,) = (folder / "demo").glob("*_room")
    return Made(folder, session, lines)


def test_demo_ends_with_a_report(demo: Made) -> None:
    assert len(list(demo.session.glob("indoor/*.jpg"))) == 9
    (page,) = (Path(line.removeprefix("report:  ")) for line in demo.lines if line.startswith("report:  "))
    text = (demo.folder / page).with_name("lab.html").read_text("utf-8")
    assert "Horizontal illuminance outdoors" in text, "the rig's k2 scaled the sky"
    assert "Alternative 3" in text
    assert len(list(page.parents[1].glob("render/staged-?.exr"))) == 3


def test_demos_last_lines_are_stills_page_and_three_commands(demo: Made) -> None:
    """First the pictures, the best one first, then the page, then what can be done next; every path is there."""
    first = next(k for k, line in enumerate(demo.lines) if line.startswith("still:"))
    stills = [line.split()[-1] for line in demo.lines[first:] if line.startswith("still:")]
    assert [Path(still).name for still in stills] == [f"still-{k}.jpg" for k in range(1, len(stills) + 1)]
    assert len(stills) >= 3
    assert all((demo.folder / still).is_file() for still in stills)
    rest = demo.lines[first + len(stills) :]
    assert rest[0].startswith("report:  ")
    assert (demo.folder / rest[0].removeprefix("report:  ")).is_file()
    assert rest[1] == "next:"
    session = demo.session.relative_to(demo.folder)
    assert [line.strip() for line in rest[2:5]] == [
        f"daylit stills {session} --into pictures",
        f"daylit relight {session} --staged 1 --sweep day",
        f"daylit export {session}",
    ]
    assert "daylit models get" in rest[5], "none is installed here"
    assert len(rest) == 6


def test_demo_warns_of_nothing_but_what_its_room_does_not_say(demo: Made) -> None:
    warnings = [line.partition("warning: ")[2] for line in demo.lines if "warning: " in line]
    assert all(warning.startswith(OF_THE_PLACE) for warning in warnings), warnings


def copied(demo: Made, into: Path, *without: str) -> Path:
    """A copy of the demo's session, without the results of some stages."""
    session = Path(shutil.copytree(demo.session, into / demo.session.name))
    for stage in without:
        shutil.rmtree(session / "stages" / stage)
    return session


def light_of(path: Path) -> np.ndarray:
    """A stage's panorama, `HALF_PX` wide, cd/m2."""
    image = read_exr(path)
    assert isinstance(image, LuminanceImage)
    return in_size(image, HALF_PX).luminance_cd_m2()


@pytest.mark.skipif(LONG, reason="beside a draft of whole pictures: the next test")
def test_a_draft_of_a_large_picture_is_worked_at_half_the_size(demo: Made) -> None:
    """The demo's small pictures stand for large ones: measured and furnished whole, emptied and staged at half."""
    assert read_exr(demo.session / "stages/calibrate/indoor.exr").rgb.shape == (HALF_PX, 2 * HALF_PX, 3)
    for name in ("remove/empty", *(f"render/staged-{k}" for k in (1, 2, 3))):
        assert read_exr(demo.session / "stages" / f"{name}.exr").rgb.shape == (HALF_PX // 2, HALF_PX, 3), name
    for still in (demo.session / "stages" / "stills").glob("still-?.jpg"):
        assert cv2.imread(str(still)).shape[1] > HALF_PX


@pytest.mark.long
def test_a_draft_of_a_large_picture_is_the_same_room_at_half_the_size(
    demo: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The demo's small pictures stand for large ones: all that is worked at a draft's size is made anew at half."""
    monkeypatch.setattr(upright, "LEAST_DRAFT_PX", HALF_PX)
    session = copied(demo, tmp_path, "remove", "materials", "render", "stills", "report")
    assert daylit.main(["process", str(session)]) == 0
    whole, half = demo.session / "stages", session / "stages"
    for name in ("room/room.json", "detect/target.png", "arrange/arrangement.json"):
        assert (half / name).read_bytes() == (whole / name).read_bytes(), name
    for name, most in (("remove/empty", 0.01), *((f"render/staged-{k}", 0.04) for k in (1, 2, 3))):
        assert read_exr(whole / f"{name}.exr").rgb.shape == (HALF_PX, 2 * HALF_PX, 3), name
        assert read_exr(half / f"{name}.exr").rgb.shape == (HALF_PX // 2, HALF_PX, 3), name
        ratio = light_of(half / f"{name}.exr") / light_of(whole / f"{name}.exr")
        assert np.median(np.abs(ratio - 1)) < most, name
        assert ratio.mean() == pytest.approx(1, abs=0.02), name
    for still in (whole / "stills").glob("still-?.jpg"):
        assert cv2.imread(str(half / "stills" / still.name)).shape == cv2.imread(str(still)).shape
    assert "Alternative 3" in (half / "report" / "lab.html").read_text("utf-8")


def test_steps_go_when_results_are_kept_and_come_back_the_same(
    demo: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = copied(demo, tmp_path)
    stages, steps = session / "stages", {one.name for one in STAGES} - set(RESULTS)
    assert daylit.main(["process", str(session), "--keep", "results"]) == 0
    assert {path.name for path in stages.iterdir() if path.is_dir()} == set(RESULTS)
    assert {path.name for path in stages.glob(".cleaned-*")} == {f".cleaned-{name}.json" for name in steps}
    capsys.readouterr()
    with all_anew():
        assert daylit.main(["process", str(session), "--until", "calibrate", "--json"]) == 0
    done = {one["stage"]: one["action"] for one in json.loads(capsys.readouterr().out)["stages"]}
    assert done == {"verify": "ran", "merge": "ran", "calibrate": "skipped"}
    for path in (demo.session / "stages" / "merge").glob("*.exr"):
        assert (stages / "merge" / path.name).read_bytes() == path.read_bytes(), path.name
    assert daylit.main(["clean", str(session), "--keep", "merge"]) == 0
    assert {path.name for path in stages.iterdir() if path.is_dir()} == {*RESULTS, "merge"}


def readme() -> list[str]:
    """README's `daylit` commands, in order, without their comments; those within the text last."""
    text = (ROOT / "README.md").read_text("utf-8")
    blocks = "\n".join(re.findall(r"^```\n(.*?)^```", text, re.M | re.S))
    lines = [line for line in blocks.replace("\\\n", " ").splitlines() if line.startswith("daylit ")]
    inline = re.findall(r"`(daylit [^`]*\S)`", " ".join(re.sub(r"^```.*?^```", "", text, flags=re.M | re.S).split()))
    return [shlex.join(shlex.split(line, comments=True)[1:]) for line in (*lines, *inline)]


def not_run(command: str) -> str | None:
    return next((why for begin, why in NEEDED.items() if command.startswith(begin)), None)


def test_each_command_of_the_readme_is_run_or_says_why_not() -> None:
    commands = readme()
    assert len(commands) >= 18
    assert all(any(one.startswith(begin) for one in commands) for begin in NEEDED), "README no longer has one of these"
    assert sum(not_run(one) is None for one in commands) >= 9


@pytest.mark.sweep
def test_the_readmes_commands_run_as_written(
    demo: Made, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In this process, which has imported what they need; the demo, and tests of commands, start programs.

    Of `daylit process` the options are read and the work is said, as the demo has done it with other options; the long
    runs do it again.
    """
    here = demo.folder / "office"
    for name, source in (("rig/chart", "rig/*_chart"), ("rig/sphere", "rig/*_sphere"), (SESSION, "*_room")):
        (found,) = (demo.folder / "demo").glob(source)
        shutil.copytree(found, here / name)
    monkeypatch.chdir(here)
    monkeypatch.setattr(webbrowser, "open", lambda *_: True)
    where = f"choices {SESSION} site=40.44,-79.99 heading=120"  # which the simple room does not say
    for command in (where, *(one for one in readme() if not_run(one) is None and one not in ("process", "verify"))):
        words = [*shlex.split(command), *(["--dry-run"] if command.startswith("process ") and not LONG else [])]
        assert daylit.main(words) == 0, (command, capsys.readouterr())
    name = Path(SESSION).name
    for made in (
        *("rig.toml", "lab.json", f"{name}-export/{name}_staged-1.jpg", f"{name}-export/{name}_room.glb"),
        *(f"{name}-proof/proof.json", f"{SESSION}/relight"),
    ):
        assert (here / made).exists(), made
