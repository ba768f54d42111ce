"""Run time against error of filling: our qualities and OpenCV's two, on emptied test rooms (exact truth)."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from benchmarks.plots import Point, time_against_error
from benchmarks.removal.real import encoded, image_of, linear
from benchmarks.removal.rivals import Rival
from processing.ground.arrays import Flags, Floats
from processing.ground.room_model import RoomModel
from processing.pictures.images import luminance_cd_m2
from processing.removal.fill import TEXELS, empty_room

Case = tuple[Floats, RoomModel, Flags, Flags]
"""The empty room's light, its model, what is to be filled, and where that is judged."""


def remove_plot(cases: Iterable[Case], others: dict[str, Rival], path: Path) -> list[Point]:
    """Measure, draw and return the points: median of the rooms' CPU seconds and median luminance errors (%)."""
    listed = list(cases)
    points = [_point("daylit", quality, listed, _ours(quality)) for quality in TEXELS]
    points += [_point(name, "", listed, _theirs(rival)) for name, rival in others.items()]
    time_against_error(
        points,
        path,
        title="Filled rooms, 1024 x 512: run time against error",
        error_label="median luminance error, %",
    )
    return points


def _ours(quality: str) -> Callable[[Case], Floats]:
    return lambda case: empty_room(image_of(case[0]), case[2], case[1], quality=quality).image.rgb


def _theirs(rival: Rival) -> Callable[[Case], Floats]:
    def fill(case: Case) -> Floats:
        scale = np.float32(0.35 / float(np.median(luminance_cd_m2(case[0]))))
        return linear(rival(np.ascontiguousarray(encoded(case[0] * scale)), case[2])) / scale

    return fill


def _point(name: str, label: str, cases: list[Case], fill: Callable[[Case], Floats]) -> Point:
    errors, seconds = [], []
    for case in cases:
        start = time.process_time()
        found = fill(case)
        seconds.append(time.process_time() - start)
        true = luminance_cd_m2(case[0])[case[3]]
        off = np.abs(luminance_cd_m2(np.ascontiguousarray(found))[case[3]] - true) / np.maximum(true, 1e-6)
        errors.append(100 * float(np.median(off)))
    return Point(name, float(np.median(seconds)), float(np.median(errors)), label)
