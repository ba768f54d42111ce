"""``daylit demo``: the main job on simulated instruments, from nothing to a report."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from station.commands.views import parameters

if TYPE_CHECKING:
    from processing.running.progress import Meter
    from processing.running.results import RunReport
    from station.session.session import SessionManifest

RIG_SIZE = "quarter"  # of the rig's sessions: a chart needs some hundred pixels
RATE, RIG_RATE = 4.0, 8.0
"""How much faster than real time room and rig are captured (chosen: slow enough to watch, too fast to wait for)."""
BESIDE_S = 600.0
"""For the rig's sessions, which take some ten seconds: a computer that is busy with other things (chosen)."""
SPHERE_WORLD = "uniform:2000"  # cd/m2 all around: what a fall-off is measured on
CHART_WORLD, CHART_STOPS = "chart:2", ("30", "20", "10", "4", "1", "1/4", "1/15", "1/60", "1/250", "1/1000", "1/4000")
"""As the guide to rig calibration has it: lit like daylight, and long enough for dark patches through an ND 3.0."""

QUICK_SIZE, QUICK_RATE, QUICK_QUALITY = "quarter", 8.0, "draft"
"""What --quick is: smaller pictures, shutters faster than life, draft quality."""
GENERATED = "bedroom-7-clear"


@click.command(params=parameters(__package__, "demo"))
def demo(world: str | None, picture: Path | None, sky: Path | None, *, as_json: bool, **asked: Any) -> int:
    """Run the whole chain on simulated instruments: capture a room and its sky, process, stage it three ways.

    The rig (meter, Theta Z1, 5D Mark II) is simulated at four times real speed and calibrated as a real one is: from a
    chart and an evenly lit sphere, captured with smaller pictures into INTO/rig. An existing calibration is reused.

    \b
    Examples:
      daylit demo
      daylit demo --quick
      daylit demo --room bedroom.jpg
      daylit demo --room apartment.hdr --sky meadow.hdr
    """
    from processing.running.progress import Meter

    meter = Meter()
    usual = (QUICK_SIZE, QUICK_RATE, QUICK_QUALITY) if asked["quick"] else ("full", RATE, "standard")
    size, rate, quality = asked["size"] or usual[0], *usual[1:]
    options = {} if asked["furniture"] is None else {"set": asked["furniture"]}
    session = _photograph(world, picture, sky, asked)
    manifest, rig, alone = None, asked["into"] / "rig", nullcontext()
    with alone if asked["capture_only"] or session is not None else _beside(rig, "kernels", waited_for=False):
        if session is None:
            seen, name = _world(world, picture, sky)
            with alone if asked["capture_only"] else _beside(rig, "sessions", waited_for=True):
                session, manifest, intact = _captured(seen, size, name, asked["into"], as_json=as_json, rate=rate)
                if asked["capture_only"] or not intact:
                    return _summary(session, manifest, intact=intact, as_json=as_json)
            options["calibration"] = str(_calibrated(rig, session, as_json=as_json))
            if manifest is not None and manifest.site.latitude_deg is not None:
                # The sun itself is beyond the shortest stop; where and when are known.
                options["repair-sun"] = "clear-sky"
        report = _processed(session, options, quality, as_json=as_json)
    return _summary(session, manifest, intact=True, as_json=as_json, report=report, meter=meter)


def _photograph(world: str | None, picture: Path | None, sky: Path | None, asked: dict[str, Any]) -> Path | None:
    """Return the session of a real photograph; None where cameras are to be simulated."""
    from station.errors import UsageError

    if world is not None and picture is not None:
        raise UsageError("--world and --room cannot be combined", where="daylit demo", advice="give one")
    if sky is not None and picture is None:
        raise UsageError("--sky needs --room", where="daylit demo", advice="also give the HDR panorama of a room")
    if picture is None or sky is not None:
        if sky is not None and picture is not None and picture.suffix.lower() not in (".hdr", ".exr"):
            text = f"{picture.name} is a photograph, which cameras cannot photograph again"
            advice = "with --sky give an HDR panorama (.hdr or .exr); leave --sky out for a photograph"
            raise UsageError(text, where="--room", advice=advice)
        return None
    if asked["size"] is not None or asked["capture_only"]:
        raise UsageError("a photograph needs no capture", where="--room", advice="leave out --size and --capture-only")
    from processing.running.panorama_session import panorama_session

    session: Path = panorama_session(picture, asked["into"])
    return session


def _world(world: str | None, picture: Path | None, sky: Path | None) -> tuple[str, str]:
    """Return the name of what the simulated instruments look at, and of the session."""
    if picture is not None:
        return f"{picture},{sky}", picture.stem
    seen = world or GENERATED
    return seen, "".join(c if c.isalnum() else "-" for c in seen)


def _captured(
    world: str, size: str, room: str, into: Path, *, as_json: bool, rate: float = 1.0, **changes: Any
) -> tuple[Path, SessionManifest, bool]:
    """Capture and verify one session; return its folder, its manifest, and whether it is whole."""
    from station.capture.capture import Capture, CaptureRequest
    from station.capture.rig import open_named_rig
    from station.commands.views import JsonView, PlainView, Rendering, TerminalView
    from station.session.verify import verify_session

    with Rendering() as rendering:
        rig = open_named_rig(None, world, size=size, rate=rate, on_progress=rendering, in_its_place=True, **changes)
    with closing(rig):
        job = Capture.new(rig, CaptureRequest(room=room, into=into))
        on_terminal = TerminalView(tuple(map(str, rig.cameras)), job.n_stops) if sys.stdout.isatty() else PlainView()
        with JsonView() if as_json else on_terminal as view:
            for event in job.events():
                view.show(event)
        manifest, path = job.store.manifest, job.store.path
        job.store.close()
    checked = verify_session(path)
    for problem in checked.problems:
        click.echo(f"{problem.file}: {problem.message}", err=as_json)
    return path, manifest, checked.intact and checked.status == "complete"


@contextmanager
def _beside(folder: Path, task: str, *, waited_for: bool) -> Iterator[None]:
    """Run a task in a process of its own meanwhile: capture the rig's ``sessions``, or compile the ``kernels``.

    Work unfinished when the block ends is ``waited_for`` or abandoned; the process logs to ``folder``/TASK.log."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{task}.log").open("wb") as log:
        command = [sys.executable, "-m", "processing.commands.demo", task, str(folder.resolve())]
        root = Path(__file__).resolve().parents[2]
        path = os.pathsep.join(filter(None, (str(root), os.environ.get("PYTHONPATH", ""))))
        helper = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, "PYTHONPATH": path})
    try:
        yield
        if waited_for and helper.poll() is None:
            click.echo(f"waiting for the rig's {task}, captured in parallel ({log.name}) ...", err=True)
            helper.wait(BESIDE_S)
    except subprocess.TimeoutExpired:
        pass
    finally:
        helper.kill()  # does nothing to one that has ended
        helper.wait()


def _meanwhile(task: str, folder: Path) -> None:
    """Do a task of `_beside`, in the process that it started."""
    if task == "kernels":
        from processing.ground.kernels import load_kernels

        load_kernels()
    elif not (folder / "calibration.json").is_file():
        _rig_session(folder, "chart", as_json=True)
        _rig_session(folder, "sphere", as_json=True)


def _rig_session(folder: Path, name: str, *, as_json: bool) -> Path:
    """Return a whole session of the chart or the sphere: the one that is there, or one captured now."""
    from drivers.errors import DaylitError
    from station.capture.rig_file import BracketTable
    from station.session.verify import verify_session

    for path in sorted(folder.glob(f"*_{name}")):
        with suppress(DaylitError):
            checked = verify_session(path)
            if checked.intact and checked.status == "complete":
                return path
    changes: dict[str, object]
    world, changes = SPHERE_WORLD, {"indoor": None, "meter": None}
    if name == "chart":
        world, changes = CHART_WORLD, {"bracket": BracketTable(stops=CHART_STOPS)}
    return _captured(world, RIG_SIZE, name, folder, as_json=as_json, rate=RIG_RATE, **changes)[0]


def _calibrated(folder: Path, room: Path, *, as_json: bool) -> Path:
    """Return the profile of the simulated rig: from sessions of the chart, the sphere and the room; made once."""
    profile = folder / "calibration.json"
    if profile.is_file():
        return profile
    from drivers.clock import SystemClock
    from processing.calibration.profile import save_profile
    from processing.rig.calibrate import RigRequest, calibrate_rig

    chart, sphere = (_rig_session(folder, name, as_json=as_json) for name in ("chart", "sphere"))
    asked = RigRequest(chart=chart, sessions=(room,), flats=(sphere,), lens_data=("theta_z1",))
    result = calibrate_rig(asked, SystemClock().utc_now(), lambda text: click.echo(text, err=True))
    save_profile(profile, result.profile)
    return profile


def _processed(session: Path, options: dict[str, str], quality: str, *, as_json: bool) -> RunReport:
    from processing.commands.process import stage_view, summary_lines
    from processing.ground.threads import give_back
    from processing.running.choices import going_on
    from processing.running.requests import RunRequest
    from processing.running.runner import process
    from station.commands.views import SilentView

    give_back(0)  # what pictures were simulated with
    run = RunRequest(first_picture=sys.stdout.isatty() and not as_json)
    with going_on(session, {**options, "quality": quality}, run, by="daylit demo") as found:
        request = found.request
        with SilentView() if as_json else stage_view() as view:
            report = process(session, request, on_event=view.show)
    if not as_json:
        for line in summary_lines(report, request, explain=False):
            click.echo(line)
    return report


def _summary(
    path: Path,
    manifest: SessionManifest | None,
    *,
    intact: bool,
    as_json: bool,
    report: RunReport | None = None,
    meter: Meter | None = None,
) -> int:
    """Say what was captured, and last where to look."""
    readings = [r.luminance_cd_m2 for r in manifest.readings] if manifest else []
    frames = manifest.frames if manifest else ()
    page = path / "stages" / "report" / "index.html"
    cost = meter.read() if meter else None
    peak = max(one.peak_bytes for one in (cost, report.cost)) if cost and report else 0
    if as_json:
        summary: dict[str, Any] = {"ok": intact, "session": str(path), "frames": len(frames)}
        processed = {} if report is None else {"report": str(page), "processing": report.to_dict()}
        spent = {} if cost is None else {"seconds": cost.seconds, "peak_bytes": peak}
        click.echo(json.dumps({**summary, "readings_cd_m2": readings, **processed, **spent}))
        return 0 if intact else 4
    if manifest:
        shown = ", ".join("none" if r is None else f"{r:.4g}" for r in readings)
        megabytes = sum(f.size_bytes for f in frames) / 1e6
        click.echo(f"{len(frames)} frames ({megabytes:.0f} MB), readings {shown} cd/m2, all digests verified")
    if report is None:
        click.echo(f"see {path}/session.json and the frames beside it")
        return 0 if intact else 4
    if cost is not None:
        click.echo(f"total: {cost.seconds / 60:.1f} min, peak memory {peak / 1e9:.2f} GB")
    from processing.commands.results import still_paths
    from processing.segmentation.installed import installed

    for still in still_paths(path):
        click.echo(f"still:   {still}")
    click.echo(f"report:  {page.resolve()}")
    click.echo("next:")
    click.echo(f"  daylit stills {path} --into pictures")
    click.echo(f"  daylit relight {path} --staged 1 --sweep day")
    click.echo(f"  daylit export {path}")
    if installed() is None:
        click.echo("for real furnished rooms, `daylit models get ade20k-deeplab` (2.3 MB) improves the masks a lot")
    return 0


if __name__ == "__main__":
    _meanwhile(sys.argv[1], Path(sys.argv[2]))
