"""The rose of light: how much falls on upright planes, by the direction they face."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from processing.errors import ParameterError
from processing.report.plots import empty_figure, svg_bytes


def illuminance_rose(values: Sequence[float], unit: str) -> bytes:
    """Return an SVG of values (0 or more) evenly around from straight ahead, clockwise as seen from above."""
    if not values or not all(math.isfinite(value) and value >= 0 for value in values):
        raise ParameterError("a rose shows one value or more, all finite and from 0")
    figure = empty_figure(4.6, 4.6)
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    angles = 2 * np.pi * np.arange(len(values)) / len(values)
    axes.bar(angles, values, width=0.92 * 2 * np.pi / len(values), color="#2f5d50", alpha=0.85, linewidth=0)
    axes.set_xticks(np.pi / 2 * np.arange(4), ("ahead", "right", "back", "left"))
    axes.set_ylim(0, max(values) * 1.05 or 1.0)
    axes.tick_params(axis="y", labelsize=8, colors="#5c6269")
    axes.set_rlabel_position(22.5)
    axes.spines["polar"].set_visible(False)
    axes.grid(linewidth=0.4, alpha=0.6)
    axes.set_title(unit, fontsize=9, color="#5c6269", loc="right")
    return svg_bytes(figure)
