"""How well a room agrees with what the pixels show: classes on floor, ceiling and walls."""

from __future__ import annotations

from processing.ground.arrays import Doubles

import math

import numpy as np
import numpy.typing as npt

from processing.segmentation.classes import SceneClass
from processing.segmentation.evidence import SceneEvidence
from processing.surfaces.sight import wall_ranges


ON_FLOOR = (SceneClass.FLOOR, SceneClass.FURNITURE, SceneClass.FIXTURE, SceneClass.TRIPOD)
ON_CEILING = (SceneClass.CEILING, SceneClass.FIXTURE)
ON_WALL = (SceneClass.WALL, SceneClass.WINDOW, SceneClass.DOOR, SceneClass.FURNITURE, SceneClass.FIXTURE)
COLUMNS = 128
LEAST_SHARE = 0.03


class ClassTable:
    """Probabilities that pixels fit on floor, ceiling or wall, summed down columns, so that a room is judged fast."""

    def __init__(self, evidence: SceneEvidence) -> None:
        step = max(1, evidence.probabilities.shape[2] // COLUMNS)
        width = evidence.probabilities.shape[2]
        chosen = np.arange(step // 2, width, step)
        part = evidence.probabilities[:, :, chosen]
        rows, columns = part.shape[1:]
        self.azimuth_rad = ((chosen + 0.5) / width - 0.5) * (2 * math.pi)
        self._edges = np.linspace(math.pi / 2, -math.pi / 2, rows + 1)
        # Solid angle, so that poles do not count for more than they show.
        weight = np.diff(-np.sin(self._edges))[:, None] / 2 / columns
        self._sums = {}
        for name, classes in (("ceiling", ON_CEILING), ("wall", ON_WALL), ("floor", ON_FLOOR)):
            share = part[[int(c) for c in classes]].sum(axis=0, dtype=np.float64)
            loss = -np.log(np.maximum(share, LEAST_SHARE)) * weight
            self._sums[name] = np.concatenate([np.zeros((1, columns)), np.cumsum(loss, axis=0)])

    def loss(self, polygon: Doubles, ratio: float) -> float:
        """Return the mean of -log(share of classes that may be there) over the sphere: 0 is perfect."""
        distance, _ = wall_ranges(polygon, self.azimuth_rad)
        up, down = np.arctan2(ratio, distance), np.arctan2(-1.0, distance)
        ceiling = self._at("ceiling", up)
        wall = self._at("wall", down) - self._at("wall", up)
        floor = self._sums["floor"][-1] - self._at("floor", down)
        return float((ceiling + wall + floor).sum())

    def _at(self, name: str, latitude: Doubles) -> Doubles:
        """Return what is summed from the top down to a latitude in each column."""
        sums = self._sums[name]
        place = np.clip((math.pi / 2 - latitude) / math.pi * (len(sums) - 1), 0, len(sums) - 1)
        row = np.minimum(place.astype(int), len(sums) - 2)
        part = place - row
        columns = np.arange(sums.shape[1])
        return np.asarray((1 - part) * sums[row, columns] + part * sums[row + 1, columns])


def overhead_share(evidence: SceneEvidence) -> float:
    """Return how much of what is above 50 degrees may be a ceiling: little of it outdoors."""
    rows = evidence.probabilities.shape[1]
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * math.pi
    above = latitude > math.radians(50)
    share = evidence.share(*ON_CEILING)[above].mean(axis=1)
    weight = np.cos(latitude[above])
    return float((share * weight).sum() / weight.sum())


def class_entropy(evidence: SceneEvidence) -> float:
    """Return the mean entropy (natural) of the classes over the sphere: how unsure the network is of what it sees."""
    share = evidence.probabilities.astype(np.float64)
    rows = -(share * np.log(np.maximum(share, 1e-6))).sum(axis=0).mean(axis=1)
    weight = np.cos((0.5 - (np.arange(len(rows)) + 0.5) / len(rows)) * math.pi)
    return float((rows * weight).sum() / weight.sum())
