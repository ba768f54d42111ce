"""What the screens show of a session, and what they write to it: corrections, which are choices like any other."""

from __future__ import annotations

import hashlib
import io
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from processing.errors import LayoutError, ParameterError
from processing.ground.room_model import RoomModel, check_room, room_text
from processing.layout.arrangement import Arrangement, Arrangements
from processing.running.choices import forget, read_choices, remember
from processing.running.results import RESULT_NAME
from processing.running.screens import STATES, picture_of
from station.errors import SessionLockedError, SessionNotFoundError
from station.session.durable import SessionLock
from station.session.folder import open_session, write_file
from station.session.session import MANIFEST_NAME
from station.session.store import SessionStore, load_manifest

BY = "daylit studio"
ROOM, MASK, ARRANGEMENT = "room.json", "mask.png", "arrangement.json"
"""Corrections: files of the session, each named by the choice that its stem names."""
LAYERS = ("mask-add.png", "mask-keep.png", "mask-sunlight.png")
"""Corrections that are drawn over the detected masks; none is an empty one."""
ESTIMATED = {
    ROOM: "stages/room/room.json",
    MASK: "stages/detect/target.png",
    ARRANGEMENT: "stages/arrange/arrangement.json",
}
MOST_MASK_PX = 1 << 26
"""Chosen: three times a mask of full size."""


class StaleError(ParameterError, code="USE-005"):
    """A correction made on a state that another tab or command has changed since."""


def session_at(folder: Path, name: str) -> Path:
    """Return the session's folder; whatever is no name of a folder there that holds a session is refused."""
    plain = re.fullmatch(r"[^/\\\x00]{1,255}", name) and name not in (".", "..")
    if not plain or not (folder / name / MANIFEST_NAME).is_file():
        raise SessionNotFoundError("there is no such session", where=name[:80])
    return folder / name


def cards(folder: Path) -> list[dict[str, Any]]:
    """Return a row for each session of the folder, the newest first; one that cannot be read says so."""
    found = [_card(path.parent) for path in folder.glob(f"*/{MANIFEST_NAME}")]
    return sorted(found, key=lambda card: (str(card["taken"]), str(card["name"])), reverse=True)


def _card(session: Path) -> dict[str, Any]:
    try:
        manifest = load_manifest(session)
    except Exception as error:  # noqa: BLE001 (one damaged session must not hide the others)
        return {"name": session.name, "title": session.name, "taken": "", "status": "damaged", "missing": [str(error)]}
    return {
        "name": session.name,
        "title": manifest.name,
        "taken": f"{manifest.created_utc:%Y-%m-%d %H:%M} UTC",
        "status": manifest.status.value,
        "missing": list(manifest.missing),
        "simulated": manifest.simulated,
        "frames": len(manifest.frames),
        "stages": stages(session),
    }


def brought(file: Path, folder: Path) -> Path:
    """Return the session that a file makes in the folder: a zip (`daylit import`), or a panorama's picture."""
    from processing.running.panorama_session import panorama_session
    from station.frames.packed import take_packed

    return take_packed(file, folder) if file.suffix.lower() == ".zip" else panorama_session(file, folder)


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


def current(session: Path, name: str) -> tuple[bytes, bool]:
    """Return a correction's file, else what was estimated, and whether it was corrected; empty: there is neither."""
    chosen = read_choices(session).chosen.get(Path(name).stem)
    corrected = session / chosen.file if chosen is not None and chosen.file else None
    for path in (corrected, session / ESTIMATED.get(name, "")):
        if path is not None and path.is_file():
            return path.read_bytes(), path == corrected
    if name not in LAYERS or not (detected := session / ESTIMATED[MASK]).is_file():
        return b"", False
    from PIL import Image

    with Image.open(detected) as found:
        Image.new("1", found.size).save(out := io.BytesIO(), "PNG")
    return out.getvalue(), False


def digest(data: bytes) -> str:
    """Return what names a state of a correction."""
    return hashlib.sha256(data).hexdigest()[:16]


def save(session: Path, name: str, data: bytes, base: str) -> str:
    """Write a correction durably and choose it; return its digest.

    ``base`` names the state that it was made on; raises `StaleError` where that is not the current one any more.
    """
    if base != digest(current(session, name)[0]):
        raise StaleError(
            "somebody else has changed this meanwhile", where=name, advice="look at what it is now, then try again"
        )
    with open_session(session) as root:
        write_file(root, name, data)
    remember(session, {Path(name).stem: session / name}, by=BY)
    return digest(data)


def drop(session: Path, name: str) -> None:
    """Go back to what was estimated; the correction's file stays where it is."""
    forget(session, [Path(name).stem])


def room_bytes(data: Any) -> bytes:
    """Return a corrected room as its file; raises `RoomError` naming all that is wrong with it."""
    if isinstance(data, dict):
        data = {**data, "source": "given", "confidence": 1.0}
    check_room(data)
    return room_text(RoomModel.model_validate_json(json.dumps(data))).encode()


def mask_bytes(png: bytes, session: Path) -> bytes:
    """Return a painted mask (PNG, white: marked) in the panorama's size, black and white."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(png)) as given, Image.open(io.BytesIO(current(session, MASK)[0])) as estimated:
            if given.format != "PNG" or given.width * given.height > MOST_MASK_PX:
                raise ParameterError("a mask is a PNG no larger than the panorama", where="mask")
            whole = given.convert("L").resize(estimated.size, Image.Resampling.BILINEAR)
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, SyntaxError, ValueError) as error:
        raise ParameterError(f"the mask cannot be read: {str(error)[:100]}", where="mask") from error
    out = io.BytesIO()
    whole.point([255 * (level >= 128) for level in range(256)]).convert("1").save(out, "PNG")
    return out.getvalue()


def plan_of(session: Path) -> Any:
    """Return the plan that furniture is arranged on: the room as corrected, a door assumed where it has none."""
    from processing.layout.assumed import with_door
    from processing.layout.plan import from_room_model

    data, _ = current(session, ROOM)
    if not data:
        raise ParameterError("the session has no room yet", where=session.name, advice="process it until room")
    room, _ = with_door(RoomModel.model_validate_json(data))
    return from_room_model(room, name="room", keep_camera_free=True)


def broken(plan: Any, arrangement: Arrangement) -> list[str]:
    """Return the hard rules that an arrangement breaks, by the judge of `daylit arrange`; empty: none."""
    from processing.layout.assumed import broken_rules

    try:
        found = broken_rules(arrangement, plan)
    except LayoutError as error:
        return [error.message]
    return found.split("; ") if found else []


def moved(session: Path, places: Mapping[str, Any]) -> Arrangements:
    """Return the session's arrangements, of which the first has pieces as ``places`` says: id to [x, y, theta, design].

    A piece that has no place is left out; metres and radians of the room's frame; a design is a name of `designs`.
    """
    data, _ = current(session, ARRANGEMENT)
    if not data:
        raise ParameterError("nothing is arranged yet", where=session.name, advice="process it until arrange")
    found = Arrangements.model_validate_json(data)
    first = found.arrangements[0]
    try:
        items = []
        for item in (one for one in first.items if one.id in places):
            x, y, theta, model = (*places[item.id], item.model)[:4]
            place: dict[str, Any] = {"t_m": (float(x), float(y), item.t_m[2]), "theta_rad": float(theta)}
            if model != item.model:
                place |= {"model": model, "size_m": designs(session)[item.category][model] or item.size_m}
            items.append(item.model_copy(update=place | {"pinned": True}))
        arrangements = (first.model_copy(update={"items": tuple(items)}), *found.arrangements[1:])
        moved_ = found.model_copy(update={"arrangements": arrangements})
        return Arrangements.model_validate_json(moved_.model_dump_json())
    except (TypeError, ValueError, KeyError) as error:
        said = f"places are [x, y, theta, design] by the piece's id: {str(error)[:80]}"
        raise ParameterError(said, where="furnish") from error


def designs(session: Path) -> dict[str, dict[str, Any]]:
    """Return by category the designs that a piece may have, and each one's own size; None: any, so the piece keeps its.

    All built-in styles (the category's name: that of the room), and what the session's own furniture has.
    """
    from processing.layout.models.catalogue import Catalogue

    own = read_choices(session).value(session, "furniture")
    every: dict[str, dict[str, Any]] = {}
    for entry in Catalogue.builtin().entries:
        every.setdefault(entry.category, {entry.category: None})[entry.model_id] = None
    for entry in () if own is None else Catalogue.at(own).entries:
        every.setdefault(entry.category, {})[entry.model_id] = entry.size_m
    return every


def captured(folder: Path) -> bool:
    """Return whether a session of the folder is being captured, by whichever program."""
    for card in cards(folder):
        if card["status"] == "partial":
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
