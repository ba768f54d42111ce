"""A session's corrections by hand: the room, what is drawn over its masks, where furniture stands, each checked."""

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from processing.errors import LayoutError, ParameterError
from processing.ground.room_model import RoomModel, check_room, room_text
from processing.layout.arrangement import Arrangement, Arrangements
from processing.running.choices import read_choices

ROOM, MASK, ARRANGEMENT = "room.json", "mask.png", "arrangement.json"
"""Corrections: files of the session, each named by the choice that its stem names."""
LAYERS = ("mask-add.png", "mask-keep.png", "mask-sunlight.png")
"""Corrections that are drawn over the detected masks; none is an empty one."""
ESTIMATED = {
    ROOM: "stages/room/room.json",
    MASK: "stages/detect/target.png",
    ARRANGEMENT: "stages/arrange/arrangement.json",
}
MOST_MASK_PX = 1 << 26  # chosen: three times a mask of full size


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
    from processing.layout.assumed import session_plan

    data, _ = current(session, ROOM)
    if not data:
        raise ParameterError("no room yet in this session", where=session.name, advice="run daylit process until room")
    return session_plan(RoomModel.model_validate_json(data))[0]


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
    if not data or not (found := Arrangements.model_validate_json(data)).arrangements:
        raise ParameterError("no arrangement yet", where=session.name, advice="run daylit process until arrange")
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

    All built-in styles (the category's name: that of the room), each in the finish of the others, too, and what the
    session's own furniture has.
    """
    from processing.layout.furniture.bench import STYLES
    from processing.layout.models.catalogue import Catalogue

    own = read_choices(session).value(session, "furniture")
    every: dict[str, dict[str, Any]] = {}
    for entry in Catalogue.builtin().entries:
        finishes = {f"{entry.model_id}/{one}": None for one in STYLES if not entry.model_id.endswith(f"/{one}")}
        every.setdefault(entry.category, {entry.category: None}).update({entry.model_id: None, **finishes})
    for entry in () if own is None else Catalogue.at(own).entries:
        every.setdefault(entry.category, {})[entry.model_id] = entry.size_m
    return every
