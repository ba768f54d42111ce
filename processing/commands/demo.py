"""``daylit demo``: the main job on simulated instruments, from nothing to a report."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from processing.running.run_report import RunReport
    from station.session import SessionManifest

RIG_SIZE = "quarter"
"""Of the rig's sessions: a chart needs some hundred pixels."""
RIG_RATE = 8.0
"""How much faster than life the rig's sessions are captured: nobody waits for their shutters."""
SPHERE_WORLD = "uniform:2000"
"""cd/m2 all around: what a fall-off is measured on."""


@click.command()
@click.option(
    "--world",
    default="room",
    show_default=True,
    help="What the simulated instruments look at: room:7, bedroom-7, chart, uniform:100, or INDOOR.hdr,OUTDOOR.hdr.",
)
@click.option("--size", type=click.Choice(["full", "half", "quarter", "small"]), default="full", show_default=True)
@click.option(
    "--into",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("demo"),
    show_default=True,
    help="Folder of sessions.",
)
@click.option("--capture-only", is_flag=True, help="End with the verified session.")
@click.option("--json", "as_json", is_flag=True, help="JSON events, then one summary object.")
def demo(world: str, size: str, into: Path, *, capture_only: bool, as_json: bool) -> int:
    """Calibrate a simulated rig, capture a simulated room at full size, process it, say where the report is.

    The rig (meter, Theta Z1, 5D Mark II) is calibrated as a real one is: from a colour chart and an evenly lit sphere,
    captured with smaller pictures into INTO/rig.

    \b
    Examples:
      daylit demo
      daylit demo --size quarter --world room:7
    """
    path, manifest, intact = _captured(world, size, "demo", into, as_json=as_json)
    if capture_only or not intact:
        return _tell(path, manifest, intact=intact, as_json=as_json)
    profile = _calibrated(into / "rig", path, as_json=as_json)
    report = _processed(path, profile, as_json=as_json)
    return _tell(path, manifest, intact=intact, as_json=as_json, report=report)


def _captured(
    world: str, size: str, room: str, into: Path, *, as_json: bool, rate: float = 1.0, **changes: object
) -> tuple[Path, SessionManifest, bool]:
    """Capture and verify one session; return its folder, its manifest, and whether it is whole."""
    from station.capture import Capture, CaptureRequest
    from station.commands.views import JsonView, PlainView, Rendering, TerminalView
    from station.rig import open_named_rig
    from station.verify import verify_session

    with Rendering() as rendering:
        rig = open_named_rig(None, world, size=size, rate=rate, on_progress=rendering, **changes)
    try:
        job = Capture.new(rig, CaptureRequest(room=room, into=into))
        on_terminal = TerminalView(tuple(map(str, rig.cameras)), job.n_stops) if sys.stdout.isatty() else PlainView()
        with JsonView() if as_json else on_terminal as view:
            for event in job.events():
                view.show(event)
        manifest, path = job.store.manifest, job.store.path
        job.store.close()
    finally:
        rig.close()
    checked = verify_session(path)
    for problem in checked.problems:
        click.echo(f"{problem.file}: {problem.message}", err=as_json)
    return path, manifest, checked.intact and checked.status == "complete"


def _calibrated(folder: Path, room: Path, *, as_json: bool) -> Path:
    """Return the profile of the simulated rig: from sessions of the chart, the sphere and the room."""
    from drivers.clock import SystemClock
    from processing.calibration.profile import save_profile
    from processing.rig.calibrate import RigRequest, calibrate_rig

    chart, _, _ = _captured("chart", RIG_SIZE, "chart", folder, as_json=as_json, rate=RIG_RATE)
    sphere, _, _ = _captured(
        SPHERE_WORLD, RIG_SIZE, "sphere", folder, as_json=as_json, rate=RIG_RATE, indoor=None, meter=None
    )
    asked = RigRequest(chart=chart, sessions=(room,), flats=(sphere,), lens_data=("theta_z1",))
    result = calibrate_rig(asked, SystemClock().utc_now(), lambda text: click.echo(text, err=True))
    profile = folder / "calibration.json"
    save_profile(profile, result.profile)
    return profile


def _processed(session: Path, profile: Path, *, as_json: bool) -> RunReport:
    from processing.commands.process_views import SilentView, plain_or_terminal, summary_lines
    from processing.running.requests import RunRequest
    from processing.running.runner import process

    request = RunRequest(options={"--calibration": profile})
    with SilentView() if as_json else plain_or_terminal(sys.stdout.isatty()) as view:
        report = process(session, request, on_event=view.show)
    if not as_json:
        for line in summary_lines(report, request, explain=False):
            click.echo(line)
    return report


def _tell(
    path: Path, manifest: SessionManifest, *, intact: bool, as_json: bool, report: RunReport | None = None
) -> int:
    readings = [r.luminance_cd_m2 for r in manifest.readings]
    page = path / "stages" / "report" / "index.html"
    if as_json:
        summary: dict[str, Any] = {"ok": intact, "session": str(path), "frames": len(manifest.frames)}
        processed = {} if report is None else {"report": str(page), "processing": report.to_dict()}
        click.echo(json.dumps({**summary, "readings_cd_m2": readings, **processed}))
        return 0 if intact else 4
    shown = ", ".join("none" if r is None else f"{r:.4g}" for r in readings)
    megabytes = sum(f.size_bytes for f in manifest.frames) / 1e6
    click.echo(f"{len(manifest.frames)} frames ({megabytes:.0f} MB), readings {shown} cd/m2, every digest checked")
    where = f"{path}/session.json and the frames beside it" if report is None else str(page)
    click.echo(f"look at: {where}")
    return 0 if intact else 4
