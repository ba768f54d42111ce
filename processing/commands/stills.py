"""``daylit stills``: framed pictures of a processed room; ``daylit proof``: what was changed in them, with digests."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import click

FOLDER = Path("stages", "stills")


def stills_of(session: Path) -> list[dict[str, Any]]:
    """Return the facts of a session's stills (docs/guides/report.md), the first the best; none where there are none."""
    from station.session import strict_json

    path = session / FOLDER / "stills.json"
    return list(strict_json.loads(path.read_bytes())["stills"]) if path.is_file() else []


def still_paths(session: Path) -> list[Path]:
    """Return a session's stills, the first the best."""
    return [session / FOLDER / one["file"] for one in stills_of(session)]


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--into", type=click.Path(path_type=Path, file_okay=False), help="Copy them into a folder.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def stills(session: Path, into: Path | None, *, as_json: bool) -> int:
    """Name the framed pictures of SESSION: JPEG of 1920 x 1280, each with the unaltered original and its light (EXR).

    `daylit process` makes them: corner to corner, upright, with a lens of 16 to 24 mm, main pieces whole, windows in.
    --into copies JPEGs and originals into a folder, to be sent.

    \b
    Examples:
      daylit stills sessions/2023-05-19T1554Z_coda-320
      daylit stills sessions/2023-05-19T1554Z_coda-320 --into pictures
    """
    from processing.errors import ProcessingError

    facts = stills_of(session)
    if not facts:
        raise ProcessingError("there are no stills yet", where=str(session), advice=f"daylit process {session}")
    folder = session / FOLDER
    names = [name for one in facts for name in (one["file"], one["original"])]
    if into is not None:
        into.mkdir(parents=True, exist_ok=True)
        for name in names:
            shutil.copyfile(folder / name, into / name)
        folder = into
    if as_json:
        click.echo(json.dumps({"ok": True, "folder": str(folder), "stills": facts}))
        return 0
    for one in facts:
        shows = f": {', '.join(one['shows'])}" if one["shows"] else ""
        click.echo(f"{folder / one['file']}  {one['state']}, {one['lens_mm']:g} mm{shows}")
        if one["statement"]:
            click.echo(f"  {one['statement']}")
    return 0


@click.command()
@click.argument("session", type=click.Path(path_type=Path))
@click.option("--into", type=click.Path(path_type=Path, file_okay=False), help="Default: SESSION's name + -proof.")
@click.option("--check", "checked", is_flag=True, help="Check the pack, and SESSION's frames, instead of writing it.")
@click.option("--digest", metavar="HEX", help="With --check: the digest that was printed when the pack was written.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def proof(session: Path, into: Path | None, *, checked: bool, digest: str | None, as_json: bool) -> int:
    """Write the proof of SESSION's stills: originals and results, what was changed, digests chained to the frames.

    Keep the digest that is printed: with it, --check finds any changed byte of pictures, frames and proof.

    \b
    Examples:
      daylit proof sessions/2023-05-19T1554Z_coda-320
      daylit proof sessions/2023-05-19T1554Z_coda-320 --check
    """
    from processing.exchange.proof import check_proof, write_proof

    if digest is not None and not checked:
        raise click.UsageError("--digest goes with --check")
    folder = into or Path(f"{session.resolve().name}-proof")
    if not checked:
        path, own = write_proof(session.resolve(), folder)
        click.echo(json.dumps({"ok": True, "file": str(path), "sha256": own}) if as_json else f"{path}\nsha256 {own}")
        return 0
    wrong = check_proof(folder, session=session.resolve(), digest=digest)
    if as_json:
        click.echo(json.dumps({"ok": not wrong, "problems": wrong}))
    else:
        for line in wrong or ["every byte is as it was"]:
            click.echo(line)
    return 1 if wrong else 0
