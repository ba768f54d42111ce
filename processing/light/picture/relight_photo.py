"""The photograph under another light: its own detail, the change of light by the scene.

A pixel is what the scene shows there under the new light, times by what the photograph differs from the scene under
the captured light: grain, seams, a picture's print. Where the two differ too much (the model is off, something hangs
in the way) less of that difference is kept. The captured patch of sun, if removal left it, goes with the sun.

What stands before the sky in a picture of the outdoors: trees and houses stay where they are under another sky.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Flags, Floats, Int64s
from processing.ground.seam import resized
from processing.light.scene.scene import Outdoors, Pane, Scene
from processing.light.solver.relight import RelightView, Relit
from processing.light.solver.sight import GLASS, looked_up
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, directions, solid_angles

FULL, NONE = 0.35, 0.9
"""Of log luminance between photograph and scene: up to which its detail is kept, and from which none of it is."""
AROUND = 0.012  # of a picture's height, to all sides: where photograph and scene are compared
MOST_GAIN = 50.0  # by which what is seen through a window may become brighter
DARK, LIGHT = 0.45, 0.7
"""Of the sky's luminance: up to which a pixel of a window shows a tree or a house, and from which it shows the sky."""
LAND_BLUR = 0.004  # of a picture's height: how far its land may lie beside where the camera sees it
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS, np.float32)


@dataclass(frozen=True)
class RelitPhotograph:
    """A photograph under another light."""

    rgb: Floats
    """(H, 2 H, 3) cd/m2."""
    detail: Floats
    """(H, 2 H): how much of the photograph's own detail is kept, 0 to 1."""


def relit_photograph(
    photograph: Floats, view: RelightView, before: Relit, after: Relit, lights: tuple[Outdoors, Outdoors]
) -> RelitPhotograph:
    """Return the photograph (H, 2 H, 3) with the light of ``after`` instead of ``before``.

    ``lights``: those of ``before`` and of ``after``.
    """
    label = view.full.label.reshape(photograph.shape[:2])
    shade = before.rgb - (view.albedo.reshape(before.sun.shape) * before.sun * np.float32(1 / math.pi))
    shown = photograph @ _WEIGHTS
    lit_off, shade_off = _apart(shown, before.rgb @ _WEIGHTS), _apart(shown, shade @ _WEIGHTS)
    by_sun = np.abs(lit_off) <= np.abs(shade_off)
    model = np.where(by_sun[..., None], before.rgb, shade)
    known = (label >= 0) & (model > 0).all(axis=-1) & (photograph > 0).all(axis=-1)
    reveals = np.array([number for number, one in enumerate(view.stage.scene.surfaces) if one.plane < 0])
    sunlit = before.sun.any(axis=-1) & ~np.isin(label, reveals)
    off = _around(np.where(by_sun, lit_off, shade_off), known, sunlit)
    detail = np.where(known, np.clip((NONE - off) / (NONE - FULL), 0, 1), 0).astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        texture = np.exp(np.log(photograph / model) * detail[..., None])
    rgb = after.rgb * np.where(detail[..., None] > 0, texture, 1)
    glass = label == GLASS
    if glass.any():
        rgb[glass] = _window(photograph[glass], view, np.flatnonzero(glass), lights)
        detail[glass] = 1
    return RelitPhotograph(np.asarray(rgb, dtype=np.float32), detail)


def photograph_under(
    photograph: Floats, view: RelightView, before: Relit, outdoors: Outdoors
) -> tuple[RelitPhotograph, Relit]:
    """Return a photograph (H, 2 H, 3), cd/m2, under another light outdoors, and the scene under it.

    ``before``: the scene under the light that the photograph was taken in, which the view's scene holds.
    """
    scene = view.stage.scene
    after = view.relit(outdoors, veils=veil_gains(scene, scene.outdoors, outdoors))
    return relit_photograph(photograph, view, before, after, (scene.outdoors, outdoors)), after


def _apart(shown: np.ndarray, model: np.ndarray) -> Floats:
    return np.asarray(np.log(np.maximum(shown, 1e-6) / np.maximum(model, 1e-6)), dtype=np.float32)


def _around(apart: Floats, known: Flags, sunlit: Flags) -> Floats:
    """Return how far photograph and scene are apart (H, 2 H): a sill is finer than albedo, so what is around counts.

    Not at the captured sun, whose edges the scene has a pixel beside."""
    side = 2 * round(AROUND * apart.shape[0]) + 1
    near, *sums = (
        cv2.blur(np.asarray(part, np.float32), (side, side)) for part in (sunlit, np.where(known, apart, 0), known)
    )
    return np.abs(np.where(near > 0, apart, sums[0] / np.maximum(sums[1], 1e-6)))


def _window(photograph: Floats, view: RelightView, chosen: Int64s, lights: tuple[Outdoors, Outdoors]) -> Floats:
    """Return what is seen through windows by some pixels: the sky as it changes there, things as the light on them.

    What covers the glass follows the light on the pane, trees, houses and the ground the light on level ground."""
    sight, scene = view.full, view.stage.scene
    rays, shown = sight.rays[chosen], photograph @ _WEIGHTS
    level_ratio = level_lx(lights[1]) / max(level_lx(lights[0]), 1e-9)
    land = land_of(lights[0])
    skies = [looked_up(bare_sky(light.rgb, land_of(light)), rays) for light in lights]
    glass = np.ones((len(chosen), 3), np.float32)
    for number, pane in enumerate(scene.panes):
        mine = sight.pane[chosen] == number
        glass[mine] = pane.through(rays[mine])
    bright = shown / np.maximum((skies[0] * glass) @ _WEIGHTS, 1e-6)
    soft = cv2.GaussianBlur(land.astype(np.float32), (0, 0), LAND_BLUR * land.shape[0])
    hidden = looked_up(np.repeat(soft[..., None], 3, axis=2), rays)[:, 0]
    share = np.clip((bright - DARK) / (LIGHT - DARK), 0, 1) * np.clip(2 - 2 * hidden, 0, 1) * (rays[:, 2] > 0)
    change = np.log(np.maximum(skies[1], 1e-6) / np.maximum(skies[0], 1e-6))
    far = share[:, None] * change + (1 - share[:, None]) * math.log(max(level_ratio, 1e-6))
    near = np.log(np.maximum(veil_gains(scene, *lights), 1e-6))[sight.pane[chosen]]
    gain = np.exp(np.where(_covered(view, chosen)[:, None], near[:, None], far))
    return np.asarray(photograph * np.clip(gain, 0, MOST_GAIN), dtype=np.float32)


def _covered(view: RelightView, chosen: Int64s) -> np.ndarray:
    """Return which pixels see what covers a pane: bars, curtains, blinds."""
    out, sight = np.zeros(len(chosen), bool), view.full
    for number, pane in enumerate(view.stage.scene.panes):
        mine = np.flatnonzero(sight.pane[chosen] == number)
        row, column = pane.cells(sight.point[chosen[mine]])
        out[mine] = pane.clear_for_sun[row, column] < 0.5
    return out


def veil_gains(scene: Scene, before: Outdoors, after: Outdoors) -> Floats:
    """Return by what the light on each pane's outer face changes (P,): curtains and blinds follow it."""
    gains = [_upon(pane, after) / max(_upon(pane, before), 1e-9) for pane in scene.panes]
    return np.clip(np.asarray(gains, np.float32), 0, 1e6)


def _upon(pane: Pane, outdoors: Outdoors) -> float:
    # Walls run counter-clockwise: across their panes and up is outwards.
    normal = np.cross(pane.across_m, pane.up_m)
    return on_plane(normal / np.linalg.norm(normal), outdoors)


HIGHEST_RAD = math.radians(30)
"""Above which nothing is looked for: a tree seen as high from outdoors shades windows, and is left as it is."""
STEP = 0.3  # of log luminance or of log colour, from one row to the next below: within a degree the sky changes less
MEMORY = 0.7  # of the sky so far, when the next row of it is taken in
COMES_BACK = 4  # rows of 0.7 degrees like the sky above: what was above them is no land; through a tree fewer show
WHITE = 0.9  # albedo above which no ground is; chosen, never swept


def level_lx(outdoors: Outdoors) -> float:
    """Return the illuminance of level ground."""
    return on_plane(np.array([0.0, 0.0, 1.0]), outdoors)


def on_plane(normal: Doubles, outdoors: Outdoors) -> float:
    """Return the illuminance, lx, outdoors on a plane that faces along a unit ``normal``, shape (3,)."""
    rows = outdoors.rgb.shape[0]
    geometry = Equirectangular(2 * rows, rows)
    share = np.maximum(directions(geometry)[0] @ normal, 0) * solid_angles(geometry)
    light = np.tensordot(share, outdoors.rgb.astype(np.float64), axes=2)
    if outdoors.sun is not None:
        facing = max(float(np.asarray(outdoors.sun.direction) @ normal), 0.0)
        light = light + facing * np.asarray(outdoors.sun.normal_illuminance_lx)
    return float(light @ _WEIGHTS)


def land_of(outdoors: Outdoors) -> Flags:
    """Return what of a picture of the outdoors (H, 2 H, 3) is not sky: (H, 2 H).

    The lower half, and from the last step of brightness or colour below 30 degrees down to the horizon: under a cloud
    the sky comes back. What is brighter than any matte thing there can be is sky too. A cloud that reaches down to the
    land is taken for land; it is as much brighter later as the land is.
    """
    rgb = outdoors.rgb
    rows = rgb.shape[0]
    first = round(rows * (0.5 - HIGHEST_RAD / math.pi))
    logs = np.log(np.maximum(rgb[: rows // 2].astype(np.float64), 1e-6))
    seen = np.stack([logs @ _WEIGHTS, logs[..., 0] - logs[..., 2]], axis=-1)
    sky = seen[max(first - 3, 0) : first + 1].mean(axis=0)
    most = np.log(np.maximum(_brightest(outdoors), 1e-6))
    start = np.full(rgb.shape[1], rows // 2)
    back = np.zeros(rgb.shape[1], int)
    for row in range(first, rows // 2):
        other = (np.abs(seen[row] - sky) > STEP).any(axis=-1) & (seen[row, :, 0] < most)
        start = np.where(other, np.minimum(start, row), start)
        back = np.where(other, 0, back + 1)
        start = np.where(back >= COMES_BACK * rows / 256, rows // 2, start)
        sky = np.where((start <= row)[:, None], sky, MEMORY * sky + (1 - MEMORY) * seen[row])
    return np.asarray(np.arange(rows)[:, None] >= start)


def _brightest(outdoors: Outdoors) -> Doubles:
    """Return the luminance (2 h,) that a matte thing may have by azimuth: towards the sun it shows its shady side."""
    columns = outdoors.rgb.shape[1]
    sun = outdoors.sun
    most = np.full(columns, WHITE / math.pi * level_lx(replace(outdoors, sun=None)))
    if sun is not None:
        azimuth = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * math.pi
        away = azimuth - math.atan2(sun.direction[0], sun.direction[1])
        lit = np.clip(0.8 - np.cos(away), 0, 1)
        most += WHITE / math.pi * lit * float(np.asarray(sun.normal_illuminance_lx) @ _WEIGHTS)
    return most


def bare_sky(rgb: Floats, land: Flags) -> Floats:
    """Return a panorama (H, 2 H, 3) with the sky carried down behind ``land`` (H, 2 H) and across the horizon."""
    rows, columns = land.shape
    out = rgb.copy()
    top = np.where(land.any(axis=0), land.argmax(axis=0), rows)
    for column in range(columns):
        out[max(top[column] - 1, 0) :, column] = out[max(top[column] - 2, 0), column]
    side = max(2, rows // 32)
    wide = np.concatenate([out[:, -side:], out, out[:, :side]], axis=1)
    smooth = cv2.blur(wide, (2 * side + 1, 3))[:, side:-side]
    edge = cv2.dilate(land.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.where(edge[..., None], smooth, out).astype(np.float32)


def with_captured_land(found: Outdoors, captured: Outdoors) -> Outdoors:
    """Return another light outdoors with the captured ground, trees and houses, as much brighter as more light falls.

    The size is that of the larger picture. A captured picture without any light is a place of which nothing is known:
    matte ground of 0.2.
    """
    before, now = level_lx(captured), level_lx(found)
    rows = max(found.rgb.shape[0], captured.rgb.shape[0])
    rgb, land = (np.array(resized(one.rgb, (rows, 2 * rows))) for one in (found, captured))
    if before <= 0:
        rgb[rows // 2 :] = 0.2 / math.pi * now
        return Outdoors(rgb, found.sun)
    where = land_of(replace(captured, rgb=land))
    return replace(found, rgb=np.where(where[..., None], land * np.float32(now / before), rgb))
