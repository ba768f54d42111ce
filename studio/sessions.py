"""What the screens show of a session, and what they write to it: corrections, which are choices like any other."""

import hashlib
import re
import threading
from pathlib import Path
from typing import Any

from processing.calibration.outdoor.sun_place import with_zone, zone_at
from processing.errors import ParameterError
from processing.ground.finished import RESULT_NAME
from processing.running.choices import forget, read_choices, remember
from processing.running.corrections import ESTIMATED, LAYERS, current
from processing.running.screens import STATES, picture_of
from station.errors import SessionLockedError, SessionNotFoundError
from station.session.durable import SessionLock
from station.session.folder import open_session, write_file
from station.session.session import MANIFEST_NAME
from station.session.store import SessionStore, load_manifest

BY = "daylit studio"
RECEIVED = "received "  # before the time of a picture of which nobody says when it was taken
_TURN = threading.Lock()  # whoever saves: what a correction was made on is compared and replaced in one go


class StaleError(ParameterError, code="USE-005"):
    """A correction made on a state that another tab or command has changed since."""


def session_at(folder: Path, name: str) -> Path:
    """Return the session's folder; whatever is no name of a folder there that holds a session is refused."""
    plain = re.fullmatch(r"[^/\\\x00]{1,255}", name) and name not in (".", "..")
    if not plain or not (folder / name / MANIFEST_NAME).is_file():
        raise SessionNotFoundError("no such session", where=name[:80])
    return folder / name


def cards(folder: Path) -> list[dict[str, Any]]:
    """Return a row for each session of the folder, the newest first; one that cannot be read says so."""
    found = [_card(path.parent) for path in folder.glob(f"*/{MANIFEST_NAME}")]
    return sorted(found, key=lambda card: (str(card["taken"]).removeprefix(RECEIVED), str(card["name"])), reverse=True)


def _card(session: Path) -> dict[str, Any]:
    try:
        manifest = load_manifest(session)
    except Exception as error:  # noqa: BLE001 (one damaged session must not hide the others)
        return {"name": session.name, "title": session.name, "taken": "", "status": "damaged", "missing": [str(error)]}
    site, when = manifest.site, manifest.taken_utc
    local = with_zone(when or manifest.created_utc, zone_at(site.latitude_deg, site.longitude_deg))
    return {
        "name": session.name,
        "title": manifest.name,
        "taken": local if when else f"{RECEIVED}{local}",
        "status": manifest.status.value,
        "missing": list(manifest.missing),
        "simulated": manifest.simulated,
        "frames": len(manifest.frames),
        "stages": stages(session),
    }


def brought(file: Path, folder: Path) -> Path:
    """Return the session that a file makes in the folder: a zip (`daylit import`), or a panorama's picture."""
    from processing.running.panorama_session import panorama_session
    from station.frames.importer import ImportRequest
    from station.frames.packed import take_packed

    if file.suffix.lower() == ".zip":
        return take_packed(file, ImportRequest(file.stem, {}, folder))[0]
    return panorama_session(file, folder)


def stages(session: Path) -> list[str]:
    """Return the stages that have a result."""
    return sorted(path.parent.name for path in session.glob(f"stages/*/{RESULT_NAME}"))


def overview(session: Path) -> dict[str, Any]:
    """Return all that the screens need to begin with: the card, which pictures there are, choices, and its stamp."""
    chosen = read_choices(session).chosen
    return {
        **_card(session),
        "states": [name for name in STATES if picture_of(session, name)],
        "chosen": {name: choice.file if choice.value is None else choice.value for name, choice in chosen.items()},
        "sunlight": (session / "stages" / "detect" / "sunlight.png").is_file(),
        "page": (session / "stages" / "report" / "index.html").is_file(),
        "stamp": stamp(session),
    }


def stamp(session: Path) -> str:
    """Return what changes whenever something of the session does: choices, corrections, results, the journal."""
    names = (MANIFEST_NAME, "journal.jsonl", "choices.toml", *ESTIMATED, *LAYERS)
    paths = [session / name for name in names] + sorted(session.glob(f"stages/*/{RESULT_NAME}"))
    seen = [(path.name, path.parent.name, path.stat().st_mtime_ns) for path in paths if path.exists()]
    return hashlib.sha256(repr(seen).encode()).hexdigest()[:16]


def digest(data: bytes) -> str:
    """Return what names a state of a correction."""
    return hashlib.sha256(data).hexdigest()[:16]


def save(session: Path, name: str, data: bytes, base: str) -> str:
    """Write a correction durably and choose it; return its digest.

    ``base`` names the state that it was made on; raises `StaleError` where that is not the current one any more.
    """
    with _TURN:
        if base != digest(current(session, name)[0]):
            raise StaleError("someone else changed this", where=name, advice="check it, then try again")
        with open_session(session) as root:
            write_file(root, name, data)
        remember(session, {Path(name).stem: session / name}, by=BY)
    return digest(data)


def drop(session: Path, name: str) -> None:
    """Go back to what was estimated; the correction's file stays where it is."""
    forget(session, [Path(name).stem])


def captured(folder: Path) -> bool:
    """Return whether a session of the folder is being captured, by whichever program."""
    for card in (one for one in cards(folder) if one["status"] == "partial"):
        try:
            with open_session(folder / str(card["name"])) as root:
                SessionLock(root).release()
        except SessionLockedError:
            return True
    return False


def capture_state(session: Path) -> dict[str, Any]:
    """Return what a capture has brought so far: frames with their shares, meter, skews, warnings, verdict."""
    with SessionStore.open(session, writable=False) as store:  # with what the journal has and session.json has not yet
        manifest = store.manifest
    frames = [frame.model_dump(mode="json", exclude_none=True) for frame in manifest.frames if not frame.is_raw]
    return manifest.model_dump(mode="json", exclude_none=True) | {"frames": frames}
