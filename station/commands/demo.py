"""``daylit demo``: the main job on simulated instruments, from nothing to a verified session."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from station.session import SessionManifest
    from station.verify import VerifyReport


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
@click.option("--json", "as_json", is_flag=True, help="JSON events, then one summary object.")
def demo(world: str, size: str, into: Path, *, as_json: bool) -> int:
    """Capture a simulated room at full size (meter, Theta Z1, 5D Mark II), verify the session, say where to look.

    \b
    Examples:
      daylit demo
      daylit demo --size quarter --world room:7
    """
    from station.capture import Capture, CaptureRequest
    from station.commands.views import JsonView, PlainView, Rendering, TerminalView
    from station.rig import open_named_rig
    from station.verify import verify_session

    with Rendering() as rendering:
        rig = open_named_rig(None, world, size=size, on_progress=rendering)
    try:
        job = Capture.new(rig, CaptureRequest(room="demo", into=into))
        on_terminal = TerminalView(tuple(map(str, rig.cameras)), job.n_stops) if sys.stdout.isatty() else PlainView()
        view = JsonView() if as_json else on_terminal
        with view:
            for event in job.events():
                view.show(event)
        manifest, path = job.store.manifest, job.store.path
        job.store.close()
    finally:
        rig.close()
    return _tell(manifest, verify_session(path), path, as_json=as_json)


def _tell(manifest: SessionManifest, report: VerifyReport, path: Path, *, as_json: bool) -> int:
    whole = report.intact and report.status == "complete"
    readings = [r.luminance_cd_m2 for r in manifest.readings]
    shown = ", ".join("none" if r is None else f"{r:.4g}" for r in readings)
    if as_json:
        summary = {"ok": whole, "session": str(path), "frames": len(manifest.frames), "readings_cd_m2": readings}
        click.echo(json.dumps({**summary, "problems": [f"{p.file}: {p.message}" for p in report.problems]}))
        return 0 if whole else 4
    for problem in report.problems:
        click.echo(f"{problem.file}: {problem.message}")
    megabytes = sum(f.size_bytes for f in manifest.frames) / 1e6
    click.echo(f"{len(manifest.frames)} frames ({megabytes:.0f} MB), readings {shown} cd/m2, every digest checked")
    click.echo(f"look at: {path}/session.json and the frames in {path}/indoor and {path}/outdoor")
    return 0 if whole else 4
