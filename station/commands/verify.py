"""``daylit verify``: is a session whole?"""

from __future__ import annotations

import json
from pathlib import Path

import click


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--fast", is_flag=True, help="Names and sizes only; reads no frame.")
@click.option("--look", is_flag=True, help="Decode each frame too, in a confined process.")
@click.option("--repair", is_flag=True, help="Write session.json anew from the journal; never deletes anything.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def verify(session: Path, *, fast: bool, look: bool, repair: bool, as_json: bool) -> int:
    """Check SESSION: every file, its size and SHA-256, nothing more, and journal and manifest agree.

    \b
    Examples:
      daylit verify sessions/2023-05-19T1554Z_coda-320
      daylit verify --look --json sessions/2023-05-19T1554Z_coda-320
    Exit code: 0 intact and complete · 4 damaged, or something is missing.
    """
    from station.frame_check import FrameChecker
    from station.verify import repair_session, verify_session

    if repair:
        repair_session(session)
    if look:
        with FrameChecker() as checker:
            report = verify_session(session, fast=fast, frame_check=checker.verify_frame)
    else:
        report = verify_session(session, fast=fast)
    whole = report.intact and report.status == "complete"
    if as_json:
        click.echo(json.dumps({"ok": whole, **report.to_dict()}))
        return 0 if whole else 4
    for problem in report.problems:
        click.echo(f"{problem.file}: {problem.message} ({problem.code})")
    for note in report.notes:
        click.echo(f"note: {note}")
    for missing in report.missing:
        click.echo(f"missing: {missing}")
    verdict = f"{len(report.problems)} problems" if report.problems else "intact"
    click.echo(f"{verdict}, {report.status}: {report.frames_checked} frames checked in {session}")
    if report.missing and report.intact:
        click.echo(f"complete it: daylit capture --resume {session}")
    return 0 if whole else 4
