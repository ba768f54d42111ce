"""What the merge did, beside the picture: which frames were used where, and what it noticed."""

from __future__ import annotations

from processing.ground.arrays import Bytes

from dataclasses import dataclass

import numpy as np

from processing.images import RelativeImage, Validity


@dataclass(frozen=True)
class FrameUse:
    """One frame's part."""

    number: int
    """As given by the caller, from 0."""
    name: str
    time_s: float
    decoded: bool
    used_share: float
    """Of the picture's runs of pixels: where its samples were looked up."""
    reason: str
    """Why not everywhere; empty: it was."""


@dataclass(frozen=True)
class Shares:
    """Shares of the picture."""

    clipped: float
    dark: float
    ghost: float

    def warnings(self) -> list[str]:
        """Say so where there is hardly a picture."""
        found = []
        if self.clipped > 0.5:
            found.append(f"{100 * self.clipped:.0f} % of the picture is clipped in every frame: shorter times needed")
        if self.dark > 0.5:
            found.append(f"{100 * self.dark:.0f} % of the picture is dark in every frame: longer times needed")
        return found


@dataclass(frozen=True)
class MergeReport:
    """What the merge did."""

    frames: tuple[FrameUse, ...]
    """In the caller's order, without duplicates."""
    warnings: tuple[str, ...]
    shares: Shares
    offset_stops: list[float]
    """How much brighter each decoded frame is than all together say, from the longest time to the shortest."""


@dataclass(frozen=True)
class Merged:
    """The picture and how it came about."""

    image: RelativeImage
    report: MergeReport


def shares(validity: Bytes, ghost: Bytes | None) -> Shares:
    """Count."""
    size = validity.size
    clipped, dark = (float(np.count_nonzero(validity == state)) / size for state in (Validity.CLIPPED, Validity.DARK))
    return Shares(clipped, dark, 0.0 if ghost is None else float(np.count_nonzero(ghost)) / size)
