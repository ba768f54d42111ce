"""Which states of the room a session has, where to look, and what the page says of them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from processing.exchange.jpeg_files import EMPTIED, STAGED, TEXT, Made, lit_by, removed_by
from processing.exchange.showing import panes_of
from processing.ground.arrays import Doubles, Floats, Vector
from processing.layout.arrangement import Arrangements
from processing.pictures.display import AS_GIVEN, Display
from processing.pictures.images import RELATIVE_UNITS, LuminanceImage, luminance_cd_m2
from processing.pictures.patch import patched
from processing.report.data import Model, Models, Section
from processing.report.states import FIELD_DEG, Cuts, Look, State, comparison
from processing.stages.contract import StageContext
from processing.stages.parameters import MOST_STAGED, ReportParameters
from processing.stages.upright import in_size, upright_panorama

HALF_FIELD = math.radians(FIELD_DEG / 2)
LOOKED_AT = 3  # alternatives that the views are turned to (chosen: as many as there usually are; more do not turn them)
LARGEST_MODEL, LARGEST_MODELS = 16_000_000, 8_000_000
"""Bytes of the first model within the page; and of all, if there are to be more."""


def room_states(context: StageContext) -> Iterator[State]:
    """Yield the room as photographed, emptied, and staged: those that there are, none asked for before its turn."""

    def photograph() -> LuminanceImage:
        image, filled = upright_panorama(context), context.optional_artifact("remove", "filled")
        return image if filled is None else in_size(image, filled.shape[1])  # a draft's others are smaller

    file = "stages/room/panorama.exr" if context.has("room", "panorama") else "stages/calibrate/indoor.exr"
    yield State("Photograph", photograph, Made(), file, "the room as photographed")
    staged = [(k, f"virtually staged, alternative {k}") for k in range(1, MOST_STAGED + 1)]
    if removed := removed_by(context.summary("remove")):
        read, made = partial(emptied_as_shown, context), Made(EMPTIED, removed, lit=lit_by(EMPTIED, context.summary))
        yield State("Emptied", read, made, "stages/remove/empty.exr", "the room without its furniture")
    for name, title, alt in ((f"staged-{k}", f"Staged {k}", alt) for k, alt in staged):
        if context.has("render", name):
            read = partial(context.artifact, "render", name)
            made = Made(STAGED, removed, lit=lit_by(STAGED, context.summary))
            yield State(title, read, made, f"stages/render/{name}.exr", alt)


def emptied_as_shown(context: StageContext) -> LuminanceImage:
    """Return the emptied room in its own sun, where that is known."""
    empty: LuminanceImage = context.artifact("remove", "empty")
    context.let_go("remove")  # so that it need not be copied
    return patched(empty, context.optional_artifact("materials", "sun"), own=True)


def views_of(context: StageContext) -> Vector:
    """Return the longitudes of the two views, and 0: towards the furniture, else towards what emptying changes most."""
    arranged: Arrangements | None = context.optional_artifact("arrange", "arrangement")
    # x, y from the camera, and size of the footprint, in metres
    places = [
        (item.t_m[0], item.t_m[1], math.sqrt(item.size_m[0] * item.size_m[1]))
        for arrangement in (arranged.arrangements[:LOOKED_AT] if arranged else ())
        for item in arrangement.items
        if item.category != "rug"
    ]
    if places and context.has("render", "staged-1"):
        return (*towards_furniture(places), 0.0)
    *_, last = states = tuple(room_states(context))
    yaw = towards(states[0].read(), last.read())
    return yaw, yaw + math.pi, 0.0


def look_of(context: StageContext, views: Vector, image: LuminanceImage) -> Look:
    """Return how the states, ``image`` one of them, are shown: in the photograph's exposure, towards these views."""
    asked = context.parameters if isinstance(context.parameters, ReportParameters) else ReportParameters()
    label, original = "" if asked.no_staged_label else TEXT, asked.original_url or ""
    known, room = context.has("stills", "display"), context.optional_artifact("room", "room")
    display = display_in(context, (image if known else next(room_states(context)).read()).rgb)
    panes = panes_of(room, image.geometry, display.views)
    return Look(display, panes, views[0], label, views[1], room, original)


def display_in(context: StageContext, rgb: Floats) -> Display:
    """Return the session's display, as its stills have it; without stills, one that exposes a picture (H, W, 3)."""
    facts = context.optional_artifact("stills", "display")
    return AS_GIVEN.exposed(rgb) if facts is None else Display.read(facts)


def towards_furniture(places: Sequence[Vector]) -> tuple[float, float]:
    """Return the longitudes of two views that show most furniture, large pieces first, and not only what is near."""
    x, y, size = np.array(places, dtype=np.float64).T
    worth = size * np.clip((np.hypot(x, y) - 0.8) / 1.2, 0.0, 1.0)
    longitudes = np.radians(np.arange(-180, 180, 2.0))
    score = np.maximum(0.0, 1 - (_apart(longitudes[:, None], np.arctan2(x, y)[None]) / HALF_FIELD) ** 4) @ worth
    first = longitudes[np.argmax(score)]
    elsewhere = np.where(_apart(longitudes, first) > 1.7 * HALF_FIELD, score, -1.0)
    second = longitudes[np.argmax(elsewhere)] if elsewhere.max() > 0 else first + math.pi
    return float(first), float(second)


def _apart(one: npt.ArrayLike, other: npt.ArrayLike) -> Doubles:
    return np.asarray(np.abs(np.angle(np.exp(1j * (np.asarray(one) - np.asarray(other))))))


def towards(before: LuminanceImage, after: LuminanceImage) -> float:
    """Return the longitude around which two panoramas of one size differ most; 0 where they do not."""
    height, width = before.rgb.shape[:2]
    step = max(1, width // 512)
    rows = slice(height // 3, None, step)
    old, new = (np.log(luminance_cd_m2(i.rgb[rows, ::step]) + 1e-3) for i in (before, after))
    weight = np.cos((0.5 - (np.arange(height)[rows] + 0.5) / height) * math.pi)
    by_column = (np.minimum(np.abs(new - old), 2.0) * weight[:, None]).sum(axis=0, dtype=np.float64)
    if by_column.sum() < 1e-3 * by_column.size:
        return 0.0
    longitudes = ((np.arange(by_column.size) + 0.5) / by_column.size - 0.5) * 2 * math.pi
    # As much as fits into a view of 90 degrees, rather than the mean of what stands all around.
    apart = _apart(longitudes[:, None], longitudes[None])
    return float(longitudes[np.argmax((np.maximum(math.pi / 4 - apart, 0)) @ by_column)])


def lead_section(cuts: Sequence[Cuts]) -> Section | None:
    """Return the states under a slider; None where there is but one."""
    if len(cuts) < 2:
        return None
    text = "Drag to compare two states of the room."
    if any(one.staged for one in cuts):
        text += " Furniture in staged pictures is virtual; what the room's own furniture hid is computer-generated."
    return Section("Before and after", text, widgets=(comparison(cuts),))


def viewer_section(cuts: Sequence[Cuts]) -> Section:
    """Return the viewer."""
    whole = replace(cuts[0].viewer, states=tuple(one.viewer.states[0] for one in cuts))
    text = (
        f"Drag to look around. The reading, in {whole.unit}, is the stored value of one pixel (to 0.05 %), with "
        "its standard uncertainty including that of the scale. Drag to draw a region or a ruler; type other limits for "
        "the false-colour scale."
    )
    if whole.unit == RELATIVE_UNITS:
        text += " This picture has no absolute scale: compare values within the room, not between rooms."
    return Section("Look around", text, widgets=(whole,))


def model_section(context: StageContext) -> Section | None:
    """Return the models of the staged room, as many as the page can hold; None where there is none."""
    every = (context.optional_artifact("render", f"staged-{k}-model") for k in range(1, MOST_STAGED + 1))
    paths = [path for path in every if path is not None]
    if not paths:
        return None
    models: list[Model] = []
    total = 0
    for number, path in enumerate(paths, 1):
        total += path.stat().st_size
        if total > (LARGEST_MODELS if models else LARGEST_MODEL):
            break
        models.append(Model(f"Staged {number}", path.read_bytes(), f"model of the staged room, alternative {number}"))
    note = _left_out(paths[len(models) :])
    if not models:
        return Section("3D model", note)
    text = "Drag to turn, scroll or pinch to zoom. Walls are visible only from inside, so you can look into the room."
    return Section("3D model", text, widgets=(Models(tuple(models), note),))


def _left_out(paths: list[Path]) -> str:
    if not paths:
        return ""
    names = ", ".join(path.name for path in paths)
    return f"Too large for this page; open in any glTF viewer: {names} in stages/render."
