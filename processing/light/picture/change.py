"""What furniture changes in a photograph, band by band of whole rows, so that a large picture needs little memory.

Furniture's edges in a large picture: smooth, as a lens shows them, not stairs.

A pixel whose middle sees one thing and whose neighbours see another is looked at by several rays. Each takes the
colour that the nearest pixel shows of the same thing; room that appears beside an edge is the photograph's own pixel,
with the change of light of its neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Floats, Int32s
from processing.light.picture.highlights import Mirrors, few_highlights, matte_share
from processing.light.picture.render import ROWS_AT_ONCE_PX
from processing.light.scene.scene import Vector
from processing.light.solver.irradiance import Effort, Irradiance, gathered
from processing.light.solver.kernels import FIRST, SECOND, compiled
from processing.light.solver.sight import FIRST_PART, Sight, albedo_of, emission_of, sight_along
from processing.light.solver.stage import Stage
from processing.light.solver.sun import sun_of
from processing.light.solver.transport import LightMap
from processing.light.solver.upsample import upsampled
from processing.pictures.images import LUMINANCE_WEIGHTS
from processing.sphere import Equirectangular, directions

LEAST_CHANGE = 0.004
"""Relative: a smaller change of light is within the noise, and the photograph's pixel is kept as it is."""
MOST_GAIN = 4.0
"""By which new furniture may brighten a place of the room."""
MISFIT = 0.5
"""Of log luminance between photograph and model, beyond which the model's sun is not believed."""
LARGE_ROWS = 1024
MOST_MIRRORED = 0.5
"""Of a floor's pixel that is taken to be mirrored light."""


@dataclass(frozen=True)
class Change:
    """A room without and with furniture, and the light of both at a small size."""

    bare: Stage
    full: Stage
    small: Sight
    before: Irradiance
    after: Irradiance
    lights: tuple[LightMap, LightMap]
    mirrors: Mirrors | None
    effort: Effort
    seed: int
    eye_m: Vector

    @cached_property
    def both(self) -> Floats:
        """(H, W, 6): irradiance before and after, brought to a large picture in one go."""
        return np.concatenate([self.before.picture, self.after.picture], axis=2)


@dataclass(frozen=True)
class _Lit:
    """Irradiance (N, 3) of a band's pixels without and with furniture, the sun's own apart."""

    old: Floats
    new: Floats
    old_sun: Floats
    new_sun: Floats


def bands(stage: Stage, geometry: Equirectangular, eye_m: Vector, halo: int = 0) -> Iterator[tuple[slice, Sight]]:
    """Yield bands of whole rows and what their pixels see; ``halo`` rows more on both sides where there are any."""
    high, wide = geometry.height_px, geometry.width_px
    step = max(1, ROWS_AT_ONCE_PX // wide)
    for start in range(0, high, step):
        rows = slice(max(0, start - halo), min(high, start + step + halo))
        rays, _ = directions(geometry, rows)
        flat = np.ascontiguousarray(rays.reshape(-1, 3), dtype=np.float32)
        yield rows, sight_along(stage, flat, eye_m, (rows.stop - rows.start, wide))


def in_bands(
    change: Change, photograph: Floats, sunless: np.ndarray | None
) -> tuple[Floats, np.ndarray, np.ndarray, Floats]:
    """Return the picture (H, W, 3), where furniture is seen, which pixels are kept, and the change of luminance."""
    shape = photograph.shape[:2]
    geometry = Equirectangular(shape[1], shape[0])
    rgb, ratio = np.empty_like(photograph), np.ones(shape, np.float32)
    furniture, kept = np.zeros(shape, bool), np.zeros(shape, bool)
    step = max(1, ROWS_AT_ONCE_PX // shape[1])
    for k, (rows, large) in enumerate(bands(change.full, geometry, change.eye_m, halo=1)):
        lacks = None if sunless is None else sunless[rows].ravel()
        shown, gain, same = _band(change, photograph[rows].reshape(-1, 3), large, rows, shape[0], lacks)
        whole = shown.reshape(photograph[rows].shape)
        smooth = smooth_edges(change.full, large, rows.start, shape[0], change.eye_m, photograph[rows], whole)
        inner = slice(k * step - rows.start, min((k + 1) * step, shape[0]) - rows.start)
        out = slice(k * step, min((k + 1) * step, shape[0]))
        rgb[out] = smooth[inner]
        furniture[out] = (large.label >= FIRST_PART).reshape(large.shape)[inner]
        ratio[out] = gain.reshape(large.shape)[inner]
        untouched = _all_three(smooth == photograph[rows])
        kept[out] = (same.reshape(large.shape) & untouched)[inner]
    return rgb, furniture, kept, ratio


def _band(
    change: Change, photo: Floats, large: Sight, rows: slice, high: int, sunless: np.ndarray | None
) -> tuple[Floats, Floats, np.ndarray]:
    """Return a band's pixels (N, 3) without smooth edges, their change of luminance (N,), and which are kept (N,)."""
    lit = _light(change, large, rows, high)
    albedo, emission = albedo_of(change.full, large), emission_of(change.full, large)
    furniture = large.label >= FIRST_PART
    gain = _gain(lit, photo, albedo, emission, large, sunless)
    shown = photo * gain
    own = albedo * matte_share(change.full, large) * (lit.new + lit.new_sun) / np.float32(np.pi) + emission
    mirrored = _mirrored(change, large, rows, high, lit.new_sun)
    if mirrored is not None:
        shown += _floor_mirror(mirrored, large.solid & ~furniture, photo, gain)
        own += mirrored.furniture
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    little = np.abs(shown - photo) < LEAST_CHANGE * np.maximum(photo, 1e-12)
    kept = ~furniture & (_all_three(little) | ~large.solid)
    out = np.where(kept[:, None], photo, np.where(furniture[:, None], own, shown)).astype(np.float32)
    return out, np.where(kept | furniture, 1, gain @ weights).astype(np.float32), kept


def _all_three(flags: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return whether all of three channels (..., 3) are set; NumPy's own reduction over three is slow."""
    return flags[..., 0] & flags[..., 1] & flags[..., 2]


def _light(change: Change, large: Sight, rows: slice, high: int) -> _Lit:
    """Return the light of a band's pixels; what no small pixel shows is gathered by rays of its own."""
    found, missed = upsampled(change.both, change.small, large, wraps=True, first_row=rows.start, rows=high)
    old, new = np.ascontiguousarray(found[:, :3]), np.ascontiguousarray(found[:, 3:])
    alone = np.flatnonzero(missed & large.solid)
    seed = change.seed + rows.start
    if len(alone):
        places = large.point[alone], large.normal[alone], 2 * change.effort.pixel_samples, seed
        old[alone] = gathered(change.bare, change.lights[0], *places)
        new[alone] = gathered(change.full, change.lights[1], *places)
    # Of a large picture several pixels share the width of a half shadow.
    samples = change.effort.sun_samples // (4 if high > LARGE_ROWS else 1)
    samples = max(samples, 8)
    furniture = large.label >= FIRST_PART
    old_sun = sun_of(change.bare, large, samples, seed, ~furniture)
    # Furniture brings no new sun to the room: only where it fell before it can fall now.
    new_sun = sun_of(change.full, large, samples, seed, furniture | ~_all_three(old_sun == 0))
    return _Lit(old, new, old_sun, new_sun)


def _gain(
    lit: _Lit, photo: Floats, albedo: Floats, emission: Floats, large: Sight, sunless: np.ndarray | None
) -> Floats:
    """Return by how much furniture changes what the room's pixels show (N, 3)."""
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    part = albedo / np.float32(np.pi)
    modelled = (part * (lit.old + lit.old_sun) + emission) @ weights
    shown = photo @ weights
    fits = np.abs(np.log(np.maximum(modelled, 1e-6) / np.maximum(shown, 1e-6))) < MISFIT
    sunny = (lit.old_sun @ weights > 0) & fits
    # Where the photograph does not show the sun that the model expects, only the rest of the light is compared; but
    # where removal took it away, or filled what furniture had shaded, it falls now.
    returns = np.zeros(len(photo), bool) if sunless is None else sunless & ~sunny
    above = part * (lit.new + np.where((sunny | returns)[:, None], lit.new_sun, 0)) + emission
    below = part * (lit.old + np.where(sunny[:, None], lit.old_sun, 0)) + emission
    usable = large.solid & _all_three(below > 0)
    ratio = np.where(usable[:, None], above / np.where(usable[:, None], below, 1), 1)
    most = np.where(returns[:, None], np.inf, MOST_GAIN)
    return np.clip(ratio, 0, most).astype(np.float32)


@dataclass(frozen=True)
class _Mirrored:
    """What a band's pixels (N, 3) mirror: the floor before and after, and furniture; 0 where nothing is mirrored."""

    old: Floats
    new: Floats
    furniture: Floats


def _mirrored(change: Change, large: Sight, rows: slice, high: int, sun: Floats) -> _Mirrored | None:
    """Return mirrored light; None where nothing mirrors. What no small pixel shows has rays of its own."""
    mirrors = change.mirrors
    if mirrors is None:
        return None
    furniture = large.label >= FIRST_PART
    among = furniture | np.isin(large.label, mirrors.floors)
    found, missed = upsampled(
        mirrors.all_three, mirrors.sight, large, wraps=True, first_row=rows.start, rows=high, among=among
    )
    old, new, own = found[:, :3], found[:, 3:6], found[:, 6:]
    own[~furniture] = 0
    chosen = np.flatnonzero(missed & furniture)
    if len(chosen):
        own[chosen] = few_highlights(mirrors, large, chosen, sun, change.seed + rows.start)
    return _Mirrored(old, new, own)


def _floor_mirror(mirrored: _Mirrored, room: npt.NDArray[np.bool_], photo: Floats, gain: Floats) -> Floats:
    """Return what is to be added (N, 3) to a glossy floor: what it mirrors now, less what it mirrored before.

    Mirrored light is not shaded where it falls, so what was mirrored before is not changed by ``gain``.
    """
    old, new = mirrored.old, mirrored.new
    # No more is taken to be mirrored than the photograph can hold: there the model is wrong, not the photograph.
    weights = np.asarray(LUMINANCE_WEIGHTS, np.float32)
    believed = np.minimum(MOST_MIRRORED * (photo @ weights) / np.maximum(old @ weights, 1e-9), 1)[:, None]
    found = np.maximum(believed * (new - old * gain), -MOST_MIRRORED * photo * gain)
    return np.where(room[:, None], found, 0).astype(np.float32)


RAYS = 8
"""In each pixel of an edge."""
STEP_M, TURNED = 0.01, 0.9
"""Height of a step, and cosine between normals, from which two pixels of one part are an edge."""


def edge_pixels(sight: Sight) -> np.ndarray:
    """Return which pixels (H, W) of a band lie at an edge of furniture; columns wrap, rows do not."""
    label = sight.label.reshape(sight.shape)
    normal, point = (each.reshape(*sight.shape, 3) for each in (sight.normal, sight.point))
    edge = np.zeros(sight.shape, bool)
    for axis in (0, 1):
        other = np.roll(label, 1, axis)
        furniture = (label >= FIRST_PART) | (other >= FIRST_PART)
        bent = np.einsum("ijk,ijk->ij", normal, np.roll(normal, 1, axis)) < TURNED
        step = np.abs(np.einsum("ijk,ijk->ij", point - np.roll(point, 1, axis), normal)) > STEP_M
        apart = furniture & ((label != other) | bent | step)
        if axis == 0:
            apart[0] = False
        edge |= apart | np.roll(apart, -1, axis)
    return edge


def smooth_edges(
    stage: Stage, sight: Sight, first_row: int, rows: int, eye_m: Vector, photograph: Floats, shown: Floats
) -> Floats:
    """Return a band's picture (H, W, 3) with smooth edges of furniture.

    Parameters
    ----------
    sight
        What the band's pixels see; its first row is row ``first_row`` of a panorama of ``rows``.
    photograph, shown
        (H, W, 3): the band without furniture, and with it, stairs and all.
    """
    row, column = np.nonzero(edge_pixels(sight))
    out = shown.copy()
    if not len(row):
        return out
    at_once = 1 << 17
    for start in range(0, len(row), at_once):
        part = slice(start, start + at_once)
        r, c = row[part].astype(np.int64), column[part].astype(np.int64)
        seen = sight_along(stage, _rays(r + first_row, c, rows), eye_m, (len(r), RAYS))
        _mix(np.stack([r, c]), _Seen.of(seen), _Seen.of(sight), photograph, shown, out)
    return out


class _Seen(NamedTuple):
    """What pixels, or the rays through them, see, for compiled loops: arrays (A, B, ...)."""

    label: Int32s
    normal: Floats
    far: Floats
    """(A, B), m."""

    @classmethod
    def of(cls, sight: Sight) -> _Seen:
        shape = sight.shape
        return cls(sight.label.reshape(shape), sight.normal.reshape(*shape, 3), sight.distance_m.reshape(shape))


def _rays(row: np.ndarray, column: np.ndarray, rows: int) -> Floats:
    """Return the directions (n x `RAYS`, 3) of places spread over pixels of a panorama."""
    k = np.arange(RAYS) + 0.5
    down, across = (k * FIRST) % 1.0, (k * SECOND) % 1.0
    latitude = (0.5 - (row[:, None] + down) / rows) * np.pi
    longitude = ((column[:, None] + across) / (2 * rows) - 0.5) * 2 * np.pi
    level = np.cos(latitude)
    found = np.stack([np.sin(longitude) * level, np.cos(longitude) * level, np.sin(latitude)], axis=-1)
    return np.ascontiguousarray(found.reshape(-1, 3), dtype=np.float32)


@compiled
def _likest(rays, i, s, y, x, pixels):  # type: ignore[no-untyped-def]
    """Return row and column of the pixel around (y, x) that shows most nearly what ray (i, s) meets; -1 where none."""
    label, normal, far = rays.label[i, s], rays.normal[i, s], rays.far[i, s]
    labels, normals, fars = pixels
    rows, columns = labels.shape
    best, at_y, at_x = -1e30, -1, -1
    for r in range(max(y - 1, 0), min(y + 2, rows)):
        for dc in range(-1, 2):
            c = (x + dc) % columns
            if labels[r, c] != label:
                continue
            score = -0.01 * (abs(r - y) + abs(dc))
            for k in range(3):
                score += 4.0 * normal[k] * normals[r, c, k]  # which way it faces counts more than how far it is
            if far < 1e6 and fars[r, c] < 1e6:
                score -= min(10.0 * abs(far - fars[r, c]) / far, 2.0)
            if score > best:
                best, at_y, at_x = score, r, c
    return at_y, at_x


@compiled
def _mix(places, rays, pixels, photograph, shown, out):  # type: ignore[no-untyped-def]
    """Fill pixels of ``out`` (H, W, 3) at ``places`` (2, N: row, column) with the mean of what their rays' likest show.

    ``rays`` and ``pixels`` are `_Seen`; ``photograph`` and ``shown`` (H, W, 3), cd/m2, without and with furniture.
    """
    samples = rays.label.shape[1]
    for i in range(places.shape[1]):
        y, x = places[0, i], places[1, i]
        red = green = blue = 0.0
        for s in range(samples):
            r, c = _likest(rays, i, s, y, x, pixels)
            if r < 0:
                r, c = y, x
            # The room itself: the photograph's own pixel, with the change of light beside it.
            gains = pixels.label[r, c] < FIRST_PART
            for k in range(3):
                value = shown[r, c, k]
                if gains:
                    value = photograph[y, x, k]
                    if photograph[r, c, k] > 0:
                        value *= min(shown[r, c, k] / photograph[r, c, k], MOST_GAIN)
                if k == 0:
                    red += value
                elif k == 1:
                    green += value
                else:
                    blue += value
        out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / samples, green / samples, blue / samples
