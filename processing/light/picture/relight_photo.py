"""The photograph under another light: its own detail, the change of light by the scene.

A pixel is what the scene shows there under the new light, times by what the photograph differs from the scene under
the captured light: grain, seams, a picture's print. Where the two differ too much (the model is off, something hangs
in the way) less of that difference is kept. The captured patch of sun, if removal left it, goes with the sun.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats, Int64s
from processing.light.picture.relight_land import bare_sky, land_of, level_lx, on_plane
from processing.light.scene.scene import Outdoors, Pane, Scene
from processing.light.solver.relight import RelightView, Relit, panes_for_sun
from processing.light.solver.sight import GLASS, looked_up
from processing.pictures.images import LUMINANCE_WEIGHTS

# What stands at a window and shades the sun wherever it is: bars, blinds, curtains; not the tree behind the glass.
#
# `windows` tells cells of a pane that show less than the sky or the ground does. A tree, a house, a shadow on the lawn
# do that too, yet they stand far away: another sun crosses the glass elsewhere. What stands at the glass runs along it:
# columns from top to bottom (frames, curtains), rows from side to side (bars, blinds from above, the sill from below).
# Below the horizon hardly anything tells bars from bushes, so that columns are told above it where there is sky.


FULL, NONE = 0.35, 0.9
"""Of log luminance between photograph and scene: up to which its detail is kept, and from which none of it is."""
MOST_GAIN = 50.0
"""By which what is seen through a window may become brighter."""
DARK, LIGHT = 0.45, 0.7
"""Of the sky's luminance: up to which a pixel of a window shows a tree or a house, and from which it shows the sky."""
LAND_BLUR = 0.004
"""Of a picture's height: how far its land may lie beside where the camera sees it."""
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
    shade = before.rgb - _direct(view, before)
    shown = photograph @ _WEIGHTS
    lit_off, shade_off = _apart(shown, before.rgb @ _WEIGHTS), _apart(shown, shade @ _WEIGHTS)
    by_sun = np.abs(lit_off) <= np.abs(shade_off)
    model = np.where(by_sun[..., None], before.rgb, shade)
    off = np.where(by_sun, np.abs(lit_off), np.abs(shade_off))
    detail = np.clip((NONE - off) / (NONE - FULL), 0, 1).astype(np.float32)
    known = (model > 0).all(axis=-1) & (photograph > 0).all(axis=-1)
    detail = np.where((label >= 0) & known, detail, 0).astype(np.float32)
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
    """Return the photograph under another light outdoors, and the scene under it.

    ``before``: the scene under the light that the photograph was taken in, which the view's scene holds.
    """
    scene = view.stage.scene
    after = view.relit(outdoors, veils=veil_gains(scene, scene.outdoors, outdoors))
    return relit_photograph(photograph, view, before, after, (scene.outdoors, outdoors)), after


def _direct(view: RelightView, relit: Relit) -> Floats:
    return view.albedo.reshape(relit.sun.shape) * relit.sun * np.float32(1 / math.pi)


def _apart(shown: np.ndarray, model: np.ndarray) -> Floats:
    return np.asarray(np.log(np.maximum(shown, 1e-6) / np.maximum(model, 1e-6)), dtype=np.float32)


def _window(photograph: Floats, view: RelightView, chosen: Int64s, lights: tuple[Outdoors, Outdoors]) -> Floats:
    """Return what is seen through windows by some pixels: the sky as it changes there, things as the light on them.

    What covers the glass follows the light on the pane, trees, houses and the ground the light on level ground.
    """
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
    for number, pane in enumerate(panes_for_sun(view.stage.scene.panes, view.basis.eye_m[2])):
        mine = np.flatnonzero(sight.pane[chosen] == number)
        row, column = pane.cells(sight.point[chosen[mine]])
        out[mine] = pane.clear[row, column] < 0.5
    return out


def veil_gains(scene: Scene, before: Outdoors, after: Outdoors) -> Floats:
    """Return by what the light on each pane's outer face changes (panes,): curtains and blinds follow it."""
    middle = np.mean([s.at(s.width_m / 2, s.height_m / 2) for s in scene.surfaces], axis=0)
    gains = [_upon(p, middle, after) / max(_upon(p, middle, before), 1e-9) for p in scene.panes]
    return np.clip(np.asarray(gains, np.float32), 0, 1e6)


def _upon(pane: Pane, middle: Doubles, outdoors: Outdoors) -> float:
    normal = np.cross(pane.across_m, pane.up_m)
    normal = normal / np.linalg.norm(normal)
    if (pane.corner_m - middle) @ normal < 0:
        normal = -normal
    return on_plane(normal, outdoors)
