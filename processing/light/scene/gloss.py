"""Gloss of the floor, coarsely: how much of the room it mirrors, told from how its brightness grows at flat angles.

A varnished or tiled floor adds to its matte light what Fresnel's law (Schlick 1994, 4 % head on) mirrors of the room.
Both are known but for one factor: radiance is matte albedo x irradiance / pi + gloss x Fresnel x mirrored radiance. The
factor is the slope of apparent albedo over the mirrored part, over many pixels, so that patterns do not matter.
"""

from __future__ import annotations

import numpy as np

from processing.ground.arrays import Doubles
from processing.light.scene.room_light import MeasuredLight
from processing.light.solver.kernels import PANE, STEP_OFF_M
from processing.light.solver.sight import Sight, looked_up
from processing.light.solver.stage import Stage
from processing.pictures.images import LUMINANCE_WEIGHTS

HEAD_ON = 0.04
"""Reflectance of varnish, glaze and polish (n = 1.5) seen head on."""
LEAST_GLOSS = 0.5
"""A smaller slope is that of a matte floor under an irradiance in error: of 13 simulated rooms (validation seeds) the
four matte floors have -1.2 to 0.3, the nine glossy ones 0.7 and more."""
TAIL, LEAST_PIXELS, LEAST_SPAN = 0.05, 200, 0.004
"""Share of pixels at either end that counts no further; too few, or too alike in what they mirror, tell nothing."""
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
        outside = looked_up(stage.scene.outdoors.rgb, back[mine]) * pane.through(back[mine])
        radiance[mine] = pane.clear[row, column, None] * outside + pane.veil_cd_m2[row, column]
    fresnel = HEAD_ON + (1 - HEAD_ON) * (1 - np.clip(cosine, 0, 1)) ** 5
    return np.asarray(fresnel[:, None] * radiance), glass


def gloss_factor(apparent: Doubles, mirror: Doubles, usable: np.ndarray) -> float:
    """Return how glossy a floor is, 0 to 1: the slope of apparent albedo (k, 3) over the mirrored part (k, 3).

    By least squares over all usable pixels, both held within their usual values, so that neither a rug nor a highlight
    decides. 0 where it cannot be told: too few pixels, or all seen alike. A slope above 1 is taken as full varnish:
    then the irradiance is in error too.
    """
    weights = np.asarray(LUMINANCE_WEIGHTS)
    y, x = (apparent @ weights)[usable], (mirror @ weights)[usable]
    if len(x) < LEAST_PIXELS:
        return 0.0
    x, y = (np.clip(v, *np.quantile(v, (TAIL, 1 - TAIL))) for v in (x, y))
    if np.ptp(x) < LEAST_SPAN:
        return 0.0
    x = x - x.mean()
    slope = float(x @ y) / float(x @ x)
    return min(slope, 1.0) if slope >= LEAST_GLOSS else 0.0
