"""Evidence that networks and image analysis give on a panorama, in one form whatever its source."""

from __future__ import annotations

from processing.ground.arrays import Doubles, Floats

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from processing.segmentation.classes import SceneClass



@dataclass(frozen=True)
class BoundaryEvidence:
    """Where walls meet floor and ceiling, behind furniture too, per column of an upright panorama.

    Column i of n looks at longitude ((i + 0.5) / n - 0.5) * 2 pi. Latitudes in radians, up positive.
    """

    ceiling_rad: Doubles
    """(n,), > 0."""
    floor_rad: Doubles
    """(n,), < 0."""
    ceiling_sigma_rad: Doubles
    """(n,): standard uncertainty."""
    floor_sigma_rad: Doubles
    corner: Floats
    """(n,), 0..1: how likely a vertical corner of the room (seen or hidden) lies in this column."""


@dataclass(frozen=True)
class SceneEvidence:
    """Class probabilities of every pixel of an upright equirectangular panorama, and its boundaries if known."""

    probabilities: Floats
    """(len(SceneClass), H, W), each pixel sums to 1; uniform where nothing is known."""
    source: str
    """Network's name and version, or file."""
    boundary: BoundaryEvidence | None = None
    views_used: int = 0
    views_skipped: int = 0
    notes: tuple[str, ...] = ()

    def share(self, *classes: SceneClass) -> Floats:
        """Return the summed probability (H, W) of some classes."""
        return np.asarray(self.probabilities[list(classes)].sum(axis=0), dtype=np.float32)
