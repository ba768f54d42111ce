"""The stage stills: the room's display, and framed pictures of it (`frames`); cheap cuts of panoramas."""

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache, partial
from typing import Any

import numpy as np

from processing.exchange.jpeg_files import Made, lit_by, removed_by, write_jpeg
from processing.exchange.showing import Shown, panes_of, shown_as
from processing.ground.room_model import RoomModel
from processing.layout.arrangement import Arrangements, PlacedItem
from processing.pictures.display import developed
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.writing import estimated
from processing.report.frames import AROUND, FEWEST, MOST, SENSOR_MM, SIZE_PX, Frame, aimed, frames_of, with_aimed
from processing.report.room_states import emptied_as_shown
from processing.sphere import Equirectangular
from processing.sphere.resampling import resample_labels
from processing.sphere.views import Panorama, cut_view
from processing.stages.contract import StageContext, StageOutput
from processing.stages.parameters import MOST_STAGED, NO_SUCH, StillsParameters
from processing.stages.upright import in_size, upright_panorama

MOST_STILLS = MOST + MOST_STAGED - 1  # of the first alternative up to `MOST`, of each further one the best
LIGHT_PX = 960  # chosen: 10 MB a still
MOST_ENLARGED, LEAST_PX = 1.5, 1280  # chosen: a draft's edges are stairs beyond; a plate's code is read from here on


def no_panorama(context: StageContext) -> str | None:
    """Return why there is nothing to frame: no whole panorama."""
    image = context.optional_artifact("calibrate", "indoor")
    if image is None:
        return "the session has no indoor picture"
    whole = isinstance(image.geometry, Equirectangular) and image.rgb.shape[1] == 2 * image.rgb.shape[0]
    return None if whole else "the indoor picture is not a whole panorama"


def run(context: StageContext) -> StageOutput:
    """Write display.json, stills.json and, for each still, its JPEG, its EXR and the unaltered original as JPEG."""
    asked = context.parameters_of(StillsParameters)
    room, facts = context.optional_artifact("room", "room"), context.artifact("calibrate", "calibration")["indoor"]
    indoor = context.artifact("calibrate", "indoor")
    shown = shown_as(upright_panorama(context), indoor, facts, room, context.session.bracket.mode)
    del indoor
    arranged: Arrangements | None = context.optional_artifact("arrange", "arrangement")
    every = () if arranged is None else arranged.arrangements
    originals, made = cache(lambda: _original(context, shown)), list[dict[str, Any]]()
    for number, one in enumerate(every[:MOST_STAGED] if room is not None else (), 1):
        name = f"staged-{number}"
        if not context.has("render", name):
            continue
        assert room is not None
        added = context.artifact("render", "staged")["alternatives"][number - 1]["added"]
        dressed = [PlacedItem.model_validate(row) for row in added]
        frames = _framed(context, room, (one.items, dressed), number, len(every))
        if number == 1:
            frames = with_aimed(aimed(asked.aim, room, one.items), frames)
        make = partial(_stills, context, shown, frames, (name, None, originals), asked, len(made))
        made += _kept(context, name, frames, len(made), make)
    if not made:
        empty = emptied_as_shown(context) if context.has("remove", "empty") else None
        name, image = ("photograph", upright_panorama(context)) if empty is None else ("emptied", empty)
        frames = with_aimed(aimed(asked.aim, room, ()), frames_of(room, ()) if room is not None else AROUND)
        made += _stills(context, shown, frames, (name, image, originals), asked, 0)
    names = [f"still-{k}" for k in range(1, MOST_STILLS + 1)]
    left_out = dict.fromkeys([n for k in names[len(made) :] for n in (k, f"{k}-original", f"{k}-light")], NO_SUCH)
    files = {name: True for k in names[: len(made)] for name in (k, f"{k}-original", f"{k}-light")}
    facts_of_all = {"schema_version": 1, "white": shown.display.said, "stills": made}
    return StageOutput(
        artifacts={"display": shown.display.to_dict(), "stills": facts_of_all, **files},
        metrics={"stills": len(made), "white": shown.display.source, "pull_stops": -math.log2(shown.display.pull)},
        left_out=left_out,
    )


def _framed(
    context: StageContext,
    room: RoomModel,
    pieces: tuple[Sequence[PlacedItem], Sequence[PlacedItem]],
    number: int,
    alternatives: int,
) -> tuple[Frame, ...]:
    """Return an alternative's frames, looked for once: the first's good ones, the others' best; `FEWEST` in all.

    ``pieces``: those of the plan, and those that dress the room."""
    (items, added), most, fewest = pieces, *((MOST, max(1, FEWEST + 1 - alternatives)) if number == 1 else (1, 1))
    own = [item.model_dump(mode="json") for item in (*items, *added)]

    def look() -> list[dict[str, Any]]:
        return [{**asdict(one), "shows": list(one.shows)} for one in frames_of(room, items, most, fewest, added)]

    found = context.part(f"frames-{number}", (), [most, fewest, own], look, apart="arrange")
    return tuple(Frame(**{**one, "shows": tuple(one["shows"])}) for one in found)


def _original(context: StageContext, shown: Shown) -> Panorama:
    """Return the photograph in the film's light, in the size of what was made of it: a draft's is smaller."""
    photograph, filled = upright_panorama(context), context.optional_artifact("remove", "filled")
    found = _whole(shown, photograph if filled is None else in_size(photograph, filled.shape[1]))
    context.let_go()  # of the measured one
    return found


def _whole(shown: Shown, image: LuminanceImage) -> Panorama:
    """Return a panorama in the film's light."""
    panes = panes_of(shown.room, image.geometry, shown.display.views)
    return Panorama(shown.display.light(np.ascontiguousarray(image.rgb), panes))


def _kept(
    context: StageContext, state: str, frames: Sequence[Frame], before: int, make: Callable[[], list[dict[str, Any]]]
) -> list[dict[str, Any]]:
    """Return the facts of a state's stills, which stay as they are where nothing of them has changed."""
    names = [f"still-{before + k}" for k in range(1, len(frames) + 1)]
    files = tuple(f"{name}{kind}" for name in names for kind in (".jpg", "-original.jpg", "-light.exr"))
    asked = context.parameters_of(StillsParameters)
    own = [state, before, [asdict(one) for one in frames], context.session.name, asked.no_staged_label]
    return [dict(one) for one in context.part(state, files, [*own, asked.original_url], make, apart="arrange")]


def _stills(
    context: StageContext,
    shown: Shown,
    frames: Sequence[Frame],
    of: tuple[str, LuminanceImage | None, Callable[[], Panorama]],
    asked: StillsParameters,
    before: int,
) -> list[dict[str, Any]]:
    """Write a state's stills, numbered from ``before`` + 1, and return their facts."""
    state, originals, image = of[0], of[2](), of[1] or context.artifact("render", of[0])
    context.let_go()  # of the state before
    what = Made.of(state, removed=removed_by(context.summary("remove")), lit=lit_by(state, context.summary))
    panoramas, measured, found = [_whole(shown, image), originals], Panorama(np.ascontiguousarray(image.rgb)), []
    widths = [_width_px(image, frame, LEAST_PX, SIZE_PX[0], MOST_ENLARGED) for frame in frames]
    framed = [(frame, wide, frame.height_px(wide)) for frame, wide in zip(frames, widths, strict=True)]
    cuts = [[developed(cut_view(one, frame.view(wide))[-rows:]) for one in panoramas] for frame, wide, rows in framed]
    panoramas.clear()  # a quarter of a gigabyte
    for number, ((frame, wide, rows), (rgb8, original)) in enumerate(zip(framed, cuts, strict=True), before + 1):
        name = f"still-{number}"
        said = what._replace(original=asked.original_url or f"{name}-original.jpg")
        how: dict[str, Any] = {"relative": not image.absolute, "quality": 90}
        plain = rgb8 if asked.no_staged_label else said.on(rgb8, panorama=False)
        write_jpeg(context.folder / f"{name}.jpg", plain, made=said, title=f"{context.session.name}, {state}", **how)
        write_jpeg(context.folder / f"{name}-original.jpg", original, title=f"{context.session.name}, original", **how)
        cut = _light(image, measured, frame)
        write_exr(context.folder / f"{name}-light.exr", estimated(cut, np.full(cut.validity.shape, bool(said.plate))))
        files = {"file": f"{name}.jpg", "original": f"{name}-original.jpg", "light": f"{name}-light.exr"}
        taken = {"yaw_deg": round(math.degrees(frame.yaw_rad), 2), "lens_mm": frame.lens_mm, "drop": frame.drop}
        rest = {"size_px": [wide, rows], "shows": list(frame.shows), "statement": said.statement}
        found.append({**files, "state": state, **taken, **rest})
    return found


def _width_px(image: LuminanceImage, frame: Frame, least_px: int, most_px: int, enlarged: float = 1.0) -> int:
    """Return a frame's width at the panorama's own density in its middle, or so many times that."""
    own = enlarged * image.rgb.shape[1] / (2 * math.pi) * SENSOR_MM / frame.lens_mm
    return max(least_px, min(most_px, int(own) // 2 * 2))


def _light(image: LuminanceImage, measured: Panorama, frame: Frame) -> LuminanceImage:
    """Return a still's light in the picture's unit: the whole level view, of which the still is the lower part.

    It has the panorama's own resolution at most, and `LIGHT_PX` of width: light is not made up by enlarging."""
    view = frame.view(_width_px(image, frame, 64, LIGHT_PX))
    rgb = cut_view(measured, view)
    doubt = cut_view(np.minimum(image.uncertainty, np.float32(1e3)), view)
    return replace(
        image,
        rgb=np.maximum(rgb, 0),
        uncertainty=np.asarray(doubt, np.float32).reshape(rgb.shape[:2]),
        validity=np.asarray(resample_labels(image.validity, measured.geometry, view), np.uint8),
        geometry=view,
        ghost=None,
        attributes={**image.attributes, "still_lens_mm": frame.lens_mm, "still_rows": frame.height_px(view.width_px)},
    )
