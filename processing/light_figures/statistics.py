"""Luminance statistics of a picture's parts, each pixel weighted by its solid angle."""

from __future__ import annotations

from processing.ground.arrays import Bytes, Doubles, Flags

from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from processing.images import Validity
from processing.room.model import RoomModel
from processing.sphere import Equirectangular
from processing.surfaces.maps import surface_maps
from processing.surfaces.planes import planes_of


QUANTILES = {"p05": 0.05, "median": 0.5, "p95": 0.95}


@dataclass(frozen=True)
class PartStatistics:
    """Luminance over a part of the sphere, in the picture's own unit."""

    name: str
    kind: str
    """whole, floor, ceiling, wall, window, door, passage."""
    solid_angle_sr: float
    mean: float
    p05: float
    median: float
    p95: float
    highest: float
    clipped_share: float
    """Of its solid angle: there the values are lower bounds."""

    def to_dict(self) -> dict[str, object]:
        """Return plain values."""
        return asdict(self)


def parts_of(room: RoomModel | None, geometry: Equirectangular) -> list[tuple[str, str, Flags]]:
    """Return name, kind and pixels (H, W) of the whole and, of a room, of its surfaces and openings as they are seen.

    Surfaces that the camera does not see are left out. A wall is counted without its openings.
    """
    shape = (geometry.height_px, geometry.width_px)
    found = [("whole", "whole", np.ones(shape, bool))]
    if room is None:
        return found
    maps = surface_maps(room, geometry)
    for plane in planes_of(room):
        kind = plane.name if plane.name in ("floor", "ceiling") else "wall"
        found.append((plane.name, kind, (maps.plane == plane.index) & (maps.opening < 0)))
    for number, opening in enumerate(room.openings):
        found.append((f"{opening.kind.value}-{number}", opening.kind.value, maps.opening == number))
    return [(name, kind, mask) for name, kind, mask in found if mask.any()]


def statistics(
    luminance: npt.NDArray[np.floating], validity: Bytes, area_sr: Doubles, part: tuple[str, str, Flags]
) -> PartStatistics | None:
    """Return a part's statistics; None where the picture shows nothing of it."""
    name, kind, mask = part
    chosen = mask & (validity != Validity.OUTSIDE) & (area_sr > 0)
    if not chosen.any():
        return None
    values, weights = luminance[chosen].astype(np.float64), area_sr[chosen]
    order = np.argsort(values, kind="stable")
    upto = np.cumsum(weights[order])
    total = float(upto[-1])
    found = {
        key: float(values[order[min(int(np.searchsorted(upto, share * total)), len(order) - 1)]])
        for key, share in QUANTILES.items()
    }
    clipped = float(weights[validity[chosen] == Validity.CLIPPED].sum()) / total
    mean = float(values @ weights) / total
    return PartStatistics(name, kind, total, mean, highest=float(values.max()), clipped_share=clipped, **found)
