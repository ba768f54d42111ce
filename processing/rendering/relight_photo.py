"""The photograph under another light: its own detail, the change of light by the scene.

A pixel is what the scene shows there under the new light, times by what the photograph differs from the scene under
the captured light: grain, seams, a picture's print. Where the two differ too much (the model is off, something hangs
in the way) less of that difference is kept. The captured patch of sun, if removal left it, goes with the sun.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.images import LUMINANCE_WEIGHTS
from processing.rendering.relight import RelightView, Relit
from processing.rendering.scene import Doubles, Floats, Outdoors, Pane, Scene
from processing.rendering.sight import GLASS
from processing.sphere import Equirectangular, directions, solid_angles

FULL, NONE = 0.35, 0.9
"""Of log luminance between photograph and scene: up to which its detail is kept, and from which none of it is."""
MOST_GAIN = 50.0
"""By which what is seen through a window may become brighter."""
FAR_OBJECT = 0.5
"""Of the sky's luminance, below which a pixel of a window shows a tree or a house, not the sky."""
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS, np.float32)


@dataclass(frozen=True)
class RelitPhotograph:
    """A photograph under another light."""

    rgb: Floats
    """(H, 2 H, 3) cd/m2."""
    detail: Floats
    """(H, 2 H): how much of the photograph's own detail is kept, 0 to 1."""


def relit_photograph(
    photograph: Floats, view: RelightView, before: Relit, after: Relit, *, level_ratio: float
) -> RelitPhotograph:
    """Return the photograph (H, 2 H, 3) with the light of ``after`` instead of ``before``.

    ``level_ratio``: light on level ground outdoors, after over before; trees and houses seen through windows take it.
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
        rgb[glass] = _window(photograph[glass], before.rgb[glass], after.rgb[glass], level_ratio)
        detail[glass] = 1
    return RelitPhotograph(np.asarray(rgb, dtype=np.float32), detail)


def _direct(view: RelightView, relit: Relit) -> Floats:
    return view.albedo.reshape(relit.sun.shape) * relit.sun * np.float32(1 / math.pi)


def _apart(shown: np.ndarray, model: np.ndarray) -> Floats:
    return np.asarray(np.log(np.maximum(shown, 1e-6) / np.maximum(model, 1e-6)), dtype=np.float32)


def _window(photograph: Floats, before: Floats, after: Floats, level_ratio: float) -> Floats:
    """Return what is seen through a window: sky as the sky there changes, things before it as the light on them."""
    sky = (photograph @ _WEIGHTS) > FAR_OBJECT * (before @ _WEIGHTS)
    gain = np.where(sky[:, None], after / np.maximum(before, 1e-6), level_ratio)
    return np.asarray(photograph * np.clip(gain, 0, MOST_GAIN), dtype=np.float32)


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
    rows = outdoors.rgb.shape[0]
    geometry = Equirectangular(2 * rows, rows)
    share = np.maximum(directions(geometry)[0] @ normal, 0) * solid_angles(geometry)
    light = np.tensordot(share, outdoors.rgb.astype(np.float64), axes=2)
    if outdoors.sun is not None:
        facing = max(float(np.asarray(outdoors.sun.direction) @ normal), 0.0)
        light = light + facing * np.asarray(outdoors.sun.normal_illuminance_lx)
    return float(light @ np.asarray(LUMINANCE_WEIGHTS))
