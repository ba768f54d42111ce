"""Gloss of the floor, coarsely: how much of the room it mirrors, told from how its brightness grows at flat angles.

A varnished or tiled floor adds to its matte light what Fresnel's law (Schlick 1994, 4 % head on) mirrors of the room.
Both are known but for one factor: radiance is matte albedo x irradiance / pi + gloss x Fresnel x mirrored radiance. The
factor is the slope of apparent albedo over that of the mirrored part, by means over many pixels, so that patterns do
not matter.
"""

from __future__ import annotations

import numpy as np

from processing.images import LUMINANCE_WEIGHTS
from processing.rendering.kernels import PANE, STEP_OFF_M
from processing.rendering.room_light import MeasuredLight
from processing.rendering.scene import Doubles
from processing.rendering.sight import Sight, looked_up
from processing.rendering.stage import Stage

HEAD_ON = 0.04
"""Reflectance of varnish, glaze and polish (n = 1.5) seen head on."""
LEAST_GLOSS = 0.15
"""A smaller factor cannot be told from the errors of irradiance."""
MOST_GLOSS = 1.3
BINS, LEAST_PIXELS, MANY_SLOPES = 12, 200, 6
MOST_SHARE = 0.3
"""Of a pixel's light that may be mirrored; more, and its albedo is not told (a window's highlight)."""


def mirrored(stage: Stage, light: MeasuredLight, sight: Sight, pixels: np.ndarray) -> tuple[Doubles, np.ndarray]:
    """Return Fresnel's share of the radiance (k, 3) that pixels (k,) mirror, and which of them mirror a window."""
    rays, normal = sight.rays[pixels], sight.normal[pixels]
    cosine = -np.einsum("ij,ij->i", rays, normal)
    back = (rays + 2 * cosine[:, None] * normal).astype(np.float32)
    start = sight.point[pixels] + np.float32(STEP_OFF_M) * normal
    hits = stage.tracer.cast(start, back)
    patch, _ = stage.met(start, back, hits)
    radiance = np.where((patch >= 0)[:, None], light.radiance[np.maximum(patch, 0)], 0)
    p = stage.patches
    glass = (hits.triangle >= 0) & (p.owner[hits.triangle] == PANE)
    for number, pane in enumerate(stage.scene.panes):
        mine = np.flatnonzero(glass & (p.item[hits.triangle] == number))
        row, column = pane.cells(start[mine] + hits.distance_m[mine, None] * back[mine])
        outside = looked_up(stage.scene.outdoors.rgb, back[mine]) * np.asarray(pane.transmittance)
        radiance[mine] = pane.clear[row, column, None] * outside + pane.veil_cd_m2[row, column]
    fresnel = HEAD_ON + (1 - HEAD_ON) * (1 - np.clip(cosine, 0, 1)) ** 5
    return np.asarray(fresnel[:, None] * radiance), glass


def gloss_factor(apparent: Doubles, mirror: Doubles, usable: np.ndarray) -> float:
    """Return how glossy a floor is, 0 to 1: the slope of apparent albedo (k, 3) over the mirrored part (k, 3).

    0 where it cannot be told: too few pixels, or all seen alike.
    """
    weights = np.asarray(LUMINANCE_WEIGHTS)
    y, x = (apparent @ weights)[usable], (mirror @ weights)[usable]
    if len(x) < LEAST_PIXELS:
        return 0.0
    edges = np.unique(np.quantile(x, np.linspace(0, 1, BINS + 1)))
    if len(edges) < 4 or edges[-1] < 1.5 * edges[0] + 0.01:
        return 0.0
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    low, high = np.quantile(y, (0.05, 0.95))
    y = np.clip(y, low, high)
    middle = np.array([[x[which == k].mean(), y[which == k].mean()] for k in range(len(edges) - 1)])
    apart = 0.3 * (middle[-1, 0] - middle[0, 0])
    slopes = [
        (b[1] - a[1]) / (b[0] - a[0]) for i, a in enumerate(middle) for b in middle[i + 1 :] if b[0] - a[0] > apart
    ]
    if len(slopes) < MANY_SLOPES:
        return 0.0
    low, factor, high = (float(q) for q in np.quantile(slopes, (0.25, 0.5, 0.75)))
    # No real floor mirrors more than full varnish: then the irradiance is wrong, not the floor glossy.
    trusted = low > 0.5 * factor and high < 2 * factor and LEAST_GLOSS <= factor <= MOST_GLOSS
    return min(factor, 1.0) if trusted else 0.0
