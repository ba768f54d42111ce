"""``daylit verify``: is a session whole?"""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from station.session.verify import VerifyReport


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
    from station.frames.check import FrameChecker
    from station.session.verify import repair_session, verify_session

    if repair:
        repair_session(session)
    if look:
        with FrameChecker() as checker:
            report = verify_session(session, fast=fast, frame_check=checker.verify_frame)
    else:
        report = verify_session(session, fast=fast)
    whole = report.intact and report.status == "complete"
    advice = _advice(report)
    if as_json:
        click.echo(json.dumps({"ok": whole, **report.to_dict(), "advice": advice}))
        return 0 if whole else 4
    for problem in report.problems:
        click.echo(f"{problem.file}: {problem.message} ({problem.code})")
    for note in report.notes:
        click.echo(f"note: {note}")
    for missing in report.missing:
        click.echo(f"missing: {missing}")
    count = len(report.problems)
    if report.intact:
        verdict = f"intact, {report.status}"
    else:
        verdict = f"NOT intact: {count} problem{'s' if count > 1 else ''}"
    click.echo(f"{verdict}; {report.frames_checked} frames checked in {session}")
    for line in advice:
        click.echo(f"  do: {line}")
    return 0 if whole else 4


_CUT_SHORT = {"manifest-behind", "manifest-differs", "journal-torn", "manifest-status"}
_LOST = {"missing", "size"}


def _advice(report: VerifyReport) -> list[str]:
    """Return what to do about the problems of a report, the first thing first."""
    codes = {problem.code for problem in report.problems}
    path = shlex.quote(report.path)
    resume = f"daylit capture --resume {path} (with the --rig or --simulate, --only and --no-meter it was begun with)"
    lines = []
    if any("this daylit knows up to" in problem.message for problem in report.problems):
        lines.append("update daylit; change nothing in the session with this version")
    elif "manifest" in codes:
        lines.append(f"daylit verify --repair {path} writes session.json anew from the journal")
    if codes & _CUT_SHORT:
        lines.append(
            "a capture is running, or was cut short; nothing saved is lost. If it is not running, go on: " + resume
        )
    if "journal" in codes:
        lines.append("restore journal.jsonl from a copy; the frames and session.json may still be whole")
    if codes & _LOST:
        lines.append("restore the files from a copy, or take them anew: " + resume)
    if codes & {"digest", "content", "unreadable"}:
        lines.append(
            "restore the files from a copy; without one, move them out of the session and take them anew: " + resume
        )
    if codes & {"extra", "irregular"}:
        lines.append("move what is not the session's out of its folder")
    if report.missing and not codes:
        lines.append("complete it: " + resume)
    return lines
