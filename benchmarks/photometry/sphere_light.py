"""What sums over the sphere are worth: uniform light, hemispheres, and a sun carried from projection to projection."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from processing.sphere import (
    Equirectangular,
    Fisheye,
    Geometry,
    LensMapping,
    Perspective,
    directions,
    point_directions,
    projected_solid_angles,
    solid_angles,
)
from processing.sphere.resampling import resample

SUN_RADIUS_RAD = math.radians(0.25)
SUN_CD_M2 = 1.6e9
POLYNOMIAL = (1.08, 0.0, -0.08)
QUICK_ROWS, ROWS = (16, 17, 64, 255), (16, 17, 18, 24, 31, 32, 64, 100, 255, 401, 512, 1000, 1680)


CUBE_FACES = ("front", "right", "back", "left", "up", "down")


def cube_views(size_px: int) -> tuple[Perspective, ...]:
    """Return six square views of 90 degrees in the order of `CUBE_FACES`; together they see everything once.

    The picture of ``up`` continues ``front`` upwards (its lower edge is the upper edge of ``front``), ``down``
    downwards.
    """
    quarter = math.pi / 2
    level = [Perspective(size_px, size_px, quarter, yaw_rad=yaw) for yaw in (0.0, quarter, math.pi, -quarter)]
    return (*level, *(Perspective(size_px, size_px, quarter, pitch_rad=pitch) for pitch in (quarter, -quarter)))


@dataclass(frozen=True)
class Sums:
    """Largest relative errors of all sizes and geometries."""

    uniform: float
    hemisphere: float
    tilted_fisheye: float
    """Of a fisheye's hemisphere on planes that are not level, where the plane's horizon cuts the picture."""


def sums(seed: int, *, quick: bool) -> Sums:
    """Integrate L = 1 over sphere and hemisphere, float32 pictures, at sizes from 16 rows up."""
    rng = np.random.default_rng([seed, 4])
    uniform, hemisphere, tilted = 0.0, 0.0, 0.0
    for rows in QUICK_ROWS if quick else ROWS:
        normals = [(0, 0, 1), (0, 0, -1), (1, 0, 0), *rng.normal(size=(2, 3))]
        for parts in ([Equirectangular(2 * rows, rows, 0.3)], [Equirectangular(2 * rows + 1, rows)], cube_views(rows)):
            uniform = max(uniform, abs(sum(_lit(solid_angles(p)) for p in parts) / (4 * math.pi) - 1))
            for normal in normals:
                light = sum(_lit(projected_solid_angles(p, normal)) for p in parts)
                hemisphere = max(hemisphere, abs(light / math.pi - 1))
        for lens in (_fisheye(mapping, rows) for mapping in LensMapping):
            uniform = max(uniform, abs(_lit(solid_angles(lens)) / (2 * math.pi) - 1))
            hemisphere = max(hemisphere, abs(_lit(projected_solid_angles(lens, (0, 0, 1))) / math.pi - 1))
            tilted = max(tilted, abs(_lit(projected_solid_angles(lens, (1, 0, 0))) / (math.pi / 2) - 1))
    return Sums(uniform, hemisphere, tilted)


def _lit(cells: np.ndarray) -> float:
    return float((np.ones(cells.shape, np.float32) * cells).sum(dtype=np.float64))


def _fisheye(mapping: LensMapping, size: int) -> Fisheye:
    return Fisheye(
        size,
        size,
        mapping,
        size / 2,
        polynomial=POLYNOMIAL if mapping is LensMapping.POLYNOMIAL else (),
        top_azimuth_rad=0.4,
    )


def geometries(size: int) -> dict[str, Geometry]:
    """Return one of each projection, about ``size`` pixels."""
    return {
        "equirectangular": Equirectangular(2 * size, size, 0.3),
        **{mapping.value: _fisheye(mapping, size) for mapping in LensMapping},
        "perspective": Perspective(size, size, math.radians(90), yaw_rad=0.6, pitch_rad=0.9, roll_rad=0.2),
    }


def pairs(*, quick: bool) -> list[tuple[str, str]]:
    """Return pairs of projections: all, or in quick runs each once as source and once as target."""
    names = list(geometries(16))
    if quick:
        return list(zip(names, names[3:] + names[:3], strict=True))
    return list(itertools.permutations(names, 2))


def sun_picture(geometry: Geometry, direction: np.ndarray, parts: int = 16) -> np.ndarray:
    """Return the sun's disc alone, each pixel the mean over its cell, float32 (H, W)."""
    d, _ = directions(geometry)
    out = np.zeros(d.shape[:2])
    offset = (np.arange(parts) + 0.5) / parts
    near = np.linalg.norm(d - direction, axis=-1) < 0.03 + 10 / geometry.height_px
    for y, x in zip(*np.nonzero(near), strict=True):
        points, seen = point_directions(geometry, x + offset, (y + offset)[:, None])
        inside = np.linalg.norm(points - direction, axis=-1) < 2 * math.sin(SUN_RADIUS_RAD / 2)
        out[y, x] = SUN_CD_M2 * (inside & seen).mean()
    return out.astype(np.float32)


def sun_errors(size: int, elevation_rad: float, *, quick: bool) -> dict[str, float]:
    """Return by pair how far the sun's illuminance, level and facing, moves when it is resampled, in per cent."""
    direction = np.array(
        [math.sin(0.55) * math.cos(elevation_rad), math.cos(0.55) * math.cos(elevation_rad), math.sin(elevation_rad)]
    )
    shown = geometries(size)
    found = {}
    cells = {name: [projected_solid_angles(g, n) for n in ((0, 0, 1), direction)] for name, g in shown.items()}
    suns = {name: sun_picture(g, direction) for name, g in shown.items()}
    for source, target in pairs(quick=quick):
        moved, _ = resample(suns[source], shown[source], shown[target])
        errors = [
            (moved * there).sum(dtype=np.float64) / (suns[source] * here).sum(dtype=np.float64) - 1
            for here, there in zip(cells[source], cells[target], strict=True)
        ]
        found[f"{source} to {target}, {size} px"] = 100 * max(errors, key=abs)
    return found
