"""What stands at a window and shades the sun wherever it is: bars, blinds, curtains; not the tree behind the glass.

`windows` tells cells of a pane that show less than the sky or the ground does. A tree, a house, a shadow on the lawn
do that too, yet they stand far away: another sun crosses the glass elsewhere. What stands at the glass runs along it:
columns from top to bottom (frames, curtains), rows from side to side (bars, blinds from above, the sill from below).
Below the horizon hardly anything tells bars from bushes, so that columns are told above it where there is sky.
"""

from __future__ import annotations

from processing.ground.arrays import Flags, Floats

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from processing.rendering.scene import Pane

MOST = 0.7
"""Of a row or a column, from which on what is covered runs along it."""
BAR_M = 0.12
"""As wide as a bar in the middle of a window may be; what is wider and does not hang from its top is outdoors."""
DRAWN = 0.85
"""Of what is seen before the sky: covered as much, all of it is a drawn blind or curtain."""



def panes_for_sun(panes: tuple[Pane, ...], eye_height_m: float) -> tuple[Pane, ...]:
    """Return the panes with what shades the sun: ``clear`` of the same size, 0 or 1."""
    return tuple(replace(pane, clear=clear_of_sun(pane, eye_height_m)) for pane in panes)


def clear_of_sun(pane: Pane, eye_height_m: float) -> Floats:
    """Return which cells of a pane (h, w) let the sun in, 0 or 1; ``eye_height_m``: from where it was looked through.

    A pane of a single cell is left as it is: nothing is known of where its covering is.
    """
    if pane.clear.size == 1:
        return pane.clear
    covered = pane.clear < 0.5
    rows, columns = covered.shape
    high_m, wide_m = (float(np.linalg.norm(v)) for v in (pane.up_m, pane.across_m))
    height = pane.corner_m[2] + pane.up_m[2] * (1 - (np.arange(rows) + 0.5) / rows)
    sky = height > eye_height_m
    if sky.mean() < 0.2:
        sky = np.ones(rows, bool)
    if covered[sky].mean() >= DRAWN:
        return np.where(covered, np.float32(0), np.float32(1))
    upright = covered[sky].mean(axis=0) >= MOST
    level = covered.mean(axis=1) >= MOST
    hung = np.logical_and.accumulate(level)
    bars = _thin(level & ~hung, BAR_M * rows / max(high_m, 1e-9))
    curtains = np.logical_and.accumulate(upright) | np.logical_and.accumulate(upright[::-1])[::-1]
    posts = _thin(upright & ~curtains, 2 * BAR_M * columns / max(wide_m, 1e-9))
    shut = (hung | bars)[:, None] | (curtains | posts)[None, :]
    return np.where(shut, np.float32(0), np.float32(1))


def _thin(told: Flags, most: float) -> Flags:
    """Return the runs of true values that are at most so long (at least one is always thin)."""
    out = np.zeros_like(told)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], told, [False]]).astype(np.int8)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        if end - start <= max(most, 1.0):
            out[start:end] = True
    return out
