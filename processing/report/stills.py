"""The stage stills: the room's display, and framed pictures of it as people want to see it; cheap cuts of panoramas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from processing.exchange.framing import MOST, SENSOR_MM, SIZE_PX, Frame, frames_of
from processing.exchange.jpeg_files import TEXT, labelled, write_jpeg
from processing.exchange.showing import Shown, shown_as
from processing.layout.arrangement import Arrangements
from processing.pictures.display import screen
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular
from processing.sphere.views import Panorama, cut_view
from processing.stages.contract import StageContext, StageOutput
from processing.stages.parameters import MOST_STAGED, NO_SUCH, StillsParameters
from processing.stages.upright import in_size, upright_panorama

MOST_STILLS = MOST + MOST_STAGED - 1
"""Of the first alternative up to `MOST`, of each further one the best."""
LIGHT_PX = 960
"""Chosen: 10 MB a still."""
EDITS = {
    "staged": "Furniture is virtual; the room's own furniture was removed by computer, and its light worked out anew.",
    "emptied": "Furniture was removed by computer, and the room's light worked out without it.",
    "photograph": "",
}
"""What a picture must say of itself (California AB 723, in force since 2026-01-01)."""


def no_panorama(context: StageContext) -> str | None:
    """Return why there is nothing to frame: no whole panorama."""
    image = context.optional_artifact("calibrate", "indoor")
    if image is None:
        return "the session has no indoor picture"
    whole = isinstance(image.geometry, Equirectangular) and image.rgb.shape[1] == 2 * image.rgb.shape[0]
    return None if whole else "the indoor picture is no whole panorama"


def run(context: StageContext) -> StageOutput:
    """Write display.json, stills.json and, for each still, its JPEG, its EXR and the unaltered original as JPEG."""
    asked = context.parameters_of(StillsParameters)
    photograph, room = upright_panorama(context), context.optional_artifact("room", "room")
    facts = context.artifact("calibrate", "calibration")["indoor"]
    indoor = context.artifact("calibrate", "indoor")
    shown = shown_as(photograph, indoor, facts, room, context.session.bracket.mode)
    arranged: Arrangements | None = context.optional_artifact("arrange", "arrangement")
    every = () if arranged is None else arranged.arrangements
    empty = context.optional_artifact("remove", "empty")
    if empty is not None:
        photograph = in_size(photograph, empty.rgb.shape[1])
    originals = _whole(shown, photograph)
    made: list[dict[str, Any]] = []
    for number in range(1, MOST_STAGED + 1):
        staged = context.optional_artifact("render", f"staged-{number}")
        if staged is not None and number <= len(every) and room is not None:
            frames = frames_of(room, every[number - 1].items, MOST if number == 1 else 1)
            made += _stills(context, shown, frames, (f"staged-{number}", staged, originals), asked, len(made))
    if not made:
        name, image = ("photograph", photograph) if empty is None else ("emptied", empty)
        frames = frames_of(room, ()) if room is not None else _around()
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


def _around() -> tuple[Frame, ...]:
    """Return three frames around a room of which nothing is known."""
    return tuple(Frame(2 * math.pi * k / 3, 20.0, 0.08) for k in (-1, 0, 1))


def _whole(shown: Shown, image: LuminanceImage) -> Panorama:
    """Return a panorama in the film's light."""
    from processing.exchange.showing import panes_of

    return Panorama(shown.display.light(np.ascontiguousarray(image.rgb), panes_of(shown.room, image.geometry)))


def _stills(
    context: StageContext,
    shown: Shown,
    frames: Sequence[Frame],
    of: tuple[str, LuminanceImage, Panorama],
    asked: StillsParameters,
    before: int,
) -> list[dict[str, Any]]:
    """Write a state's stills, numbered from ``before`` + 1, and return their facts."""
    state, image, originals = of
    kind = state.partition("-")[0]
    light, measured = _whole(shown, image), Panorama(np.ascontiguousarray(image.rgb))
    found = []
    for number, frame in enumerate(frames, before + 1):
        name, view, rows = f"still-{number}", frame.view(), frame.height_px()
        rgb8, original = (screen(cut_view(one, view)[-rows:]) for one in (light, originals))
        statement = _statement(kind, f"{name}-original.jpg", asked.original_url)
        if kind == "staged" and not asked.no_staged_label:
            rgb8 = labelled(rgb8, TEXT, panorama=False, link=asked.original_url)
        how: dict[str, Any] = {"relative": not image.absolute, "quality": 90}
        title = f"{context.session.name}, {state}"
        edited = kind != "photograph"
        write_jpeg(
            context.folder / f"{name}.jpg", rgb8, staged=edited, title=title, statement=statement, **how
        )  # fmt: skip
        write_jpeg(context.folder / f"{name}-original.jpg", original, title=f"{context.session.name}, original", **how)
        write_exr(context.folder / f"{name}-light.exr", _light(image, measured, frame))
        found.append(
            {
                "file": f"{name}.jpg",
                "original": f"{name}-original.jpg",
                "light": f"{name}-light.exr",
                "state": state,
                "yaw_deg": round(math.degrees(frame.yaw_rad), 2),
                "lens_mm": frame.lens_mm,
                "drop": frame.drop,
                "size_px": list(SIZE_PX),
                "shows": list(frame.shows),
                "statement": statement,
            }
        )
    return found


def _statement(kind: str, original: str, url: str | None) -> str:
    """Return what was changed and where the unaltered original is; nothing of a photograph."""
    return f"{EDITS[kind]} Unaltered original: {url or original}" if EDITS[kind] else ""


def _light(image: LuminanceImage, measured: Panorama, frame: Frame) -> LuminanceImage:
    """Return a still's light in the picture's unit: the whole level view, of which the still is the lower part.

    It has the panorama's own resolution at most, and `LIGHT_PX` of width: light is not made up by enlarging.
    """
    own = measured.geometry.width_px / (2 * math.pi) * SENSOR_MM / frame.lens_mm
    view = frame.view(max(64, min(LIGHT_PX, int(own) // 2 * 2)))
    rgb = cut_view(measured, view)
    shape = rgb.shape[:2]
    doubt = cut_view(np.minimum(image.uncertainty, np.float32(1e3)), view)
    return replace(
        image,
        rgb=np.maximum(rgb, 0),
        uncertainty=np.asarray(doubt, np.float32).reshape(shape),
        validity=np.zeros(shape, np.uint8),
        geometry=view,
        ghost=None,
        attributes={**image.attributes, "still_lens_mm": frame.lens_mm, "still_rows": frame.height_px(view.width_px)},
    )
