"""Walls and heights to a part of a pixel: where the full-size picture shows the edges that the room predicts.

First, for all walls at once, how far each is to be moved and how much the ceiling, so that floor and ceiling edges
are met together: a skirting's upper edge, a rug's border or a cornice would each need another ceiling. Then each column
gives the place of its edge, and the walls are fitted to these places, robustly. Where furniture hides the boundary, or
nothing is to be seen, the network's boundary stands.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from processing.ground.arrays import Doubles, Flags, Floats, Int16s
from processing.pictures.images import LuminanceImage, RelativeImage, luminance_cd_m2
from processing.room.columns import Columns
from processing.room.held import Held
from processing.room.hypotheses import Fit, fitted
from processing.room.outline import Outline
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.sphere import Equirectangular
from processing.sphere.resampling import linear_samples
from processing.surfaces.maps import wall_ranges

# Strips of the full-size picture along predicted boundaries, and the edges in them.
#
# A strip holds log luminance over offsets in latitude from the prediction, one column an azimuth. HDR is used as it is:
# log differences are contrasts of the surfaces, in the darkest corner and beside a window alike.
REACH_RAD = math.radians(2.6)  # of a strip to both sides
SIDE_RAD = math.radians(0.3)  # height that is averaged on either side of an edge; at least a pixel
LEAST_CONTRAST = 0.08  # log difference at which an edge counts half
DARK_SHARE = 1e-3  # of the picture's median luminance, below which contrast is noise


@dataclass(frozen=True)
class Strip:
    """Edges along one boundary: strength (N, OFFSETS) in 0..1, at latitudes prediction + ``offset_rad``."""

    offset_rad: Doubles
    strength: Floats
    contrast: Floats
    """(N, OFFSETS): log luminance above less below."""

    def at(self, offsets: Doubles) -> Doubles:
        """Return the strength at offsets (rad) of shape (..., N), one a column; 0 beyond the strip."""
        place = (offsets - self.offset_rad[0]) / (self.offset_rad[1] - self.offset_rad[0])
        inside = (place >= 0) & (place <= len(self.offset_rad) - 1)
        low = np.clip(place.astype(int), 0, len(self.offset_rad) - 2)
        part = np.clip(place - low, 0, 1)
        columns = np.arange(self.strength.shape[0])
        value = (1 - part) * self.strength[columns, low] + part * self.strength[columns, low + 1]
        return np.where(inside, value, 0.0)


def strip_along(image: RelativeImage | LuminanceImage, azimuth_rad: Doubles, latitude_rad: Doubles) -> Strip:
    """Return the edges around latitudes (N,) predicted at azimuths (N,), of an equirectangular picture."""
    geometry = image.geometry
    assert isinstance(geometry, Equirectangular)
    pixel = math.pi / geometry.height_px
    step = max(pixel, math.radians(0.05)) / 2
    reach = math.ceil(REACH_RAD / step)
    offset = np.arange(-reach, reach + 1) * step
    side = max(round(max(SIDE_RAD, pixel) / step), 1)
    wide = np.arange(-reach - side, reach + side + 1) * step
    light = _log_luminance(image, geometry, azimuth_rad, np.clip(latitude_rad[:, None] + wide, -1.55, 1.55))
    running = np.concatenate([np.zeros((len(light), 1)), np.cumsum(light, axis=1)], axis=1)
    middle = np.arange(side, side + len(offset))
    # The sample in the middle belongs to neither side.
    above = running[:, middle + 1 + side] - running[:, middle + 1]
    below = running[:, middle] - running[:, middle - side]
    contrast = (above - below) / side
    strength = contrast**2 / (contrast**2 + LEAST_CONTRAST**2)
    return Strip(np.asarray(offset, dtype=np.float64), strength.astype(np.float32), contrast.astype(np.float32))


def _log_luminance(
    image: RelativeImage | LuminanceImage, geometry: Equirectangular, azimuth_rad: Doubles, latitude_rad: Doubles
) -> Doubles:
    turns = (azimuth_rad - geometry.yaw_rad) / (2 * math.pi) + 0.5
    x = (turns % 1.0) * geometry.width_px - 0.5
    y = np.clip((0.5 - latitude_rad / math.pi) * geometry.height_px - 0.5, 0, geometry.height_px - 1)
    columns = np.broadcast_to(x[:, None], y.shape).astype(np.float32)
    light = luminance_cd_m2(linear_samples(image.rgb, columns, y.astype(np.float32), cv2.BORDER_WRAP))
    step = max(1, geometry.height_px // 64)
    usual = float(np.median(luminance_cd_m2(image.rgb[::step, ::step])))
    return np.log(np.maximum(light, max(usual * DARK_SHARE, 1e-12)).astype(np.float64))


def peaks_near(strip: Strip, expected: Doubles, within_rad: float, least: float) -> tuple[Doubles, Flags]:
    """Return each column's strongest edge near an expected offset (N,), to a part of a step, and which have one.

    Edges farther away count less; a column whose strength does not come down on both sides has none.
    """
    step = strip.offset_rad[1] - strip.offset_rad[0]
    away = strip.offset_rad[None] - expected[:, None]
    near = np.abs(away) <= within_rad
    size = np.abs(strip.contrast)
    value = np.where(near, size * (1 - 0.5 * (away / within_rad) ** 2), 0.0)
    best = np.clip(value.argmax(axis=1), 1, len(strip.offset_rad) - 2)
    columns = np.arange(len(best))
    before, here, after = (size[columns, best + k].astype(np.float64) for k in (-1, 0, 1))
    bend = before - 2 * here + after
    found = (strip.strength[columns, best] >= least) & near[columns, best]
    found &= (bend < 0) & (here >= before) & (here >= after)
    shift = np.where(found, 0.5 * (before - after) / np.where(bend < 0, bend, -1.0), 0.0)
    return strip.offset_rad[best] + np.clip(shift, -0.5, 0.5) * step, found


# Walls and ceiling moved onto the edges.
AZIMUTHS = 768
SHIFTS = np.linspace(-0.08, 0.08, 81)  # relative changes of a wall's distance that are tried
SHIFT_SIGMA = 0.03  # chosen, never swept
RATIO_SHIFTS = np.linspace(-0.06, 0.06, 61)
RATIO_SHIFT_SIGMA = 0.015  # chosen, never swept
RATIO_WEIGHT = 4.0  # the network's word on the heights stands on all columns at once
SKIRTING = (0.025, 0.08)
"""Relative distances by which a skirting's upper edge seems farther than its lower one: 4 to 12 cm of 1.6 m."""
SKIRTING_LESS = 0.7  # chosen, never swept
SKIRTING_SEEN = 0.5  # strength of a second edge above the floor's from which the wall has a skirting
SKIRTING_DEPTH = 0.009
"""By which a skirting stands before its wall, in camera heights: 14 mm of 1.6 m, as most do; the floor ends there."""
PEAK_WITHIN_RAD = math.radians(0.35)
LEAST_STRENGTH = 0.25  # chosen, never swept
EDGE_SIGMA_RAD = math.radians(0.12)
STRENGTH_WITHIN_RAD = math.radians(0.2)
LEAST_COLUMNS = 8  # columns with an edge that make a wall refined
LEAST_GAIN = 0.08  # mean strength along a wall below which it shows no edge
PROBE_RAD = math.radians(2.0)  # how far from a boundary the classes are asked what is there
UPRIGHT = [SceneClass.WALL, SceneClass.DOOR, SceneClass.WINDOW]
LEAST_CLEAR = 0.5  # more likely than not
COLUMN_WEIGHT = 0.25  # of a column in choosing shifts: neighbours carry the same evidence


@dataclass(frozen=True)
class Refined:
    """A room after refinement, in camera heights."""

    polygon: Doubles
    outline: Outline
    edges: int = 0
    """Walls of which an edge was found."""
    floor_share: float = 0.0
    """Share of the azimuths at which the floor's edge was found."""
    ceiling_share: float = 0.0
    strength: float = 0.0
    """Mean edge strength (0..1) along floor and ceiling boundaries; hidden ones count as 0. 0..2 together."""
    skipped: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Moves:
    """What meets the edges best."""

    shift: Doubles
    """(WALLS,): of the logarithm of each wall's distance."""
    ratio_shift: float
    """Of the logarithm of the heights' ratio."""
    strength: Doubles
    """(WALLS,): mean strength of the edges met."""
    skirting: Flags
    """(WALLS,): whether a second edge runs above the floor's."""


@dataclass(frozen=True)
class _Sight:
    """The predicted boundaries at `AZIMUTHS` azimuths, strips along them, and where they can be seen."""

    azimuth_rad: Doubles
    wall: Int16s
    floor_rad: Doubles
    ceiling_rad: Doubles
    floor: Strip
    ceiling: Strip
    floor_clear: Flags
    ceiling_clear: Flags


def unrefined(fit: Fit, why: str) -> Refined:
    """Return a fitted room as it was, and why."""
    return Refined(fit.polygon, fit.outline, skipped=(f"edges in the picture: {why}",))


def refine(
    image: RelativeImage | LuminanceImage, evidence: SceneEvidence, fit: Fit, columns: Columns, held: Held | None = None
) -> Refined:
    """Return a fitted room with its walls on the picture's edges (not what is held); as it was where there are none."""
    if not fit.outline.walls:
        return unrefined(fit, "the room is a bare polygon")
    sight = _look(image, evidence, fit)
    measured, found = _measured(sight, _moves(sight, len(fit.polygon)), fit, columns)
    again = fitted(fit.outline, measured if held is None else held.on(measured))
    if again is None:
        return unrefined(fit, "they make no room")
    count = np.bincount(sight.wall, weights=(found[0] | found[1]), minlength=len(fit.polygon))
    seen = np.unique(sight.wall)
    without = [int(w) for w in seen if count[w] < LEAST_COLUMNS]
    skipped = (f"edges of {len(without)} of {len(seen)} walls in sight: none is clear of furniture",) if without else ()
    # How strong the edges are that a room predicts, of strips laid along a room much like it
    distance, _ = wall_ranges(again.polygon, sight.azimuth_rad)
    floor = -np.arctan2(1.0, distance) - sight.floor_rad
    ceiling = np.arctan2(again.outline.ratio, distance) - sight.ceiling_rad
    around = np.linspace(-STRENGTH_WITHIN_RAD, STRENGTH_WITHIN_RAD, 9)[:, None]
    floor_strength = sight.floor.at(floor + around).max(axis=0) * sight.floor_clear
    ceiling_strength = sight.ceiling.at(ceiling + around).max(axis=0) * sight.ceiling_clear
    return Refined(
        again.polygon,
        again.outline,
        edges=len(seen) - len(without),
        floor_share=float(found[0].mean()),
        ceiling_share=float(found[1].mean()),
        strength=float(floor_strength.mean() + ceiling_strength.mean()),
        skipped=skipped,
    )


def _look(image: RelativeImage | LuminanceImage, evidence: SceneEvidence, fit: Fit) -> _Sight:
    azimuth = ((np.arange(AZIMUTHS) + 0.5) / AZIMUTHS - 0.5) * (2 * math.pi)
    distance, wall = wall_ranges(fit.polygon, azimuth)
    floor, ceiling = -np.arctan2(1.0, distance), np.arctan2(fit.outline.ratio, distance)
    over, under = _classes(evidence, azimuth, ceiling + PROBE_RAD), _classes(evidence, azimuth, ceiling - PROBE_RAD)
    floor_clear = floor_seen(evidence, azimuth, floor)
    ceiling_clear = (over[SceneClass.CEILING] >= LEAST_CLEAR) & (under[UPRIGHT].sum(axis=0) >= LEAST_CLEAR)
    strips = strip_along(image, azimuth, floor), strip_along(image, azimuth, ceiling)
    return _Sight(azimuth, wall, floor, ceiling, *strips, floor_clear, ceiling_clear)


def floor_seen(evidence: SceneEvidence, azimuth_rad: Doubles, floor_rad: Doubles) -> Flags:
    """Return where the floor is seen to end at a wall, at azimuths and latitudes (N,): floor below, wall above."""
    above, below = (_classes(evidence, azimuth_rad, floor_rad + probe) for probe in (PROBE_RAD, -PROBE_RAD))
    return np.asarray((below[SceneClass.FLOOR] >= LEAST_CLEAR) & (above[UPRIGHT].sum(axis=0) >= LEAST_CLEAR))


def _classes(evidence: SceneEvidence, azimuth_rad: Doubles, latitude_rad: Doubles) -> Floats:
    """Return the probabilities (CLASSES, N) at places of the sphere."""
    rows, columns = evidence.probabilities.shape[1:]
    x = ((azimuth_rad / (2 * math.pi) + 0.5) * columns).astype(int) % columns
    return evidence.probabilities[:, np.clip(((0.5 - latitude_rad / math.pi) * rows).astype(int), 0, rows - 1), x]


def _moved(sight: _Sight, shift: npt.ArrayLike, ratio_shift: float = 0.0) -> tuple[Doubles, Doubles]:
    """Return offsets of floor and ceiling (..., N) where walls are farther by exp(shift)."""
    closer = np.exp(-np.asarray(shift, dtype=np.float64))
    floor = np.arctan(closer * np.tan(sight.floor_rad)) - sight.floor_rad
    ceiling = np.arctan(closer * math.exp(ratio_shift) * np.tan(sight.ceiling_rad)) - sight.ceiling_rad
    return floor, ceiling


def _moves(sight: _Sight, walls: int) -> _Moves:
    """Return how far all walls and the ceiling are to be moved to meet the edges together."""
    floor_offset, _ = _moved(sight, np.broadcast_to(SHIFTS[:, None], (len(SHIFTS), AZIMUTHS)))
    floor = sight.floor.at(floor_offset) * sight.floor_clear
    # For the ceiling only the difference of both shifts counts.
    both = np.arange(-(len(RATIO_SHIFTS) // 2) - len(SHIFTS) // 2, len(RATIO_SHIFTS) // 2 + len(SHIFTS) // 2 + 1)
    step = SHIFTS[1] - SHIFTS[0]
    _, ceiling_offset = _moved(sight, np.broadcast_to((both * step)[:, None], (len(both), AZIMUTHS)))
    ceiling = sight.ceiling.at(ceiling_offset) * sight.ceiling_clear
    by_wall = np.zeros((walls, AZIMUTHS))
    by_wall[sight.wall, np.arange(AZIMUTHS)] = 1.0
    floor_sum, ceiling_sum = by_wall @ floor.T, by_wall @ ceiling.T
    floor_mean = floor_sum / np.maximum(by_wall @ sight.floor_clear, 1.0)[:, None]
    floor_sum *= 1 - SKIRTING_LESS * _below(floor_mean)
    prior = -0.5 * (SHIFTS / SHIFT_SIGMA) ** 2
    best, chosen, ratio_shift = -np.inf, np.zeros(walls, int), 0.0
    for k, ratio in enumerate(RATIO_SHIFTS):
        # Ceiling shift = wall shift - ratio shift; columns of ceiling_sum count from the least.
        first = len(RATIO_SHIFTS) - 1 - k
        total = COLUMN_WEIGHT * (floor_sum + ceiling_sum[:, first : first + len(SHIFTS)]) + prior
        value = float(total.max(axis=1).sum()) - 0.5 * RATIO_WEIGHT * (ratio / RATIO_SHIFT_SIGMA) ** 2
        if value > best:
            best, chosen, ratio_shift = value, total.argmax(axis=1), float(ratio)
            first_best = first
    rows = np.arange(walls)
    strength = floor_sum[rows, chosen] + ceiling_sum[rows, chosen + first_best]
    clear = by_wall @ (sight.floor_clear.astype(float) + sight.ceiling_clear)
    above = _below(floor_mean[:, ::-1])[:, ::-1][rows, chosen]
    return _Moves(SHIFTS[chosen], ratio_shift, strength / np.maximum(clear, 1.0), above >= SKIRTING_SEEN)


def _below(floor: Doubles) -> Doubles:
    """Return (WALLS, SHIFTS) the strongest edge that a skirting's lower edge would make, were this its upper one."""
    step = SHIFTS[1] - SHIFTS[0]
    out = np.zeros_like(floor)
    for lag in range(round(SKIRTING[0] / step), round(SKIRTING[1] / step) + 1):
        out[:, lag:] = np.maximum(out[:, lag:], floor[:, :-lag])
    return out


def _measured(sight: _Sight, moves: _Moves, fit: Fit, columns: Columns) -> tuple[Columns, tuple[Flags, Flags]]:
    """Return columns with the edges found as boundaries, and the network's, less sure, elsewhere."""
    usable = moves.strength[sight.wall] >= LEAST_GAIN
    floor_offset, ceiling_offset = _moved(sight, moves.shift[sight.wall], moves.ratio_shift)
    floor_at, floor_found = peaks_near(sight.floor, floor_offset, PEAK_WITHIN_RAD, LEAST_STRENGTH)
    ceiling_at, ceiling_found = peaks_near(sight.ceiling, ceiling_offset, PEAK_WITHIN_RAD, LEAST_STRENGTH)
    floor_found &= sight.floor_clear & usable
    ceiling_found &= sight.ceiling_clear & usable
    # As many azimuths as columns fell on each: the network's word must not grow by being repeated.
    often = math.sqrt(AZIMUTHS / len(columns.azimuth_rad))
    around = {
        name: np.interp(sight.azimuth_rad, columns.azimuth_rad, getattr(columns, name), period=2 * math.pi)
        for name in ("floor", "floor_sigma", "ceiling", "ceiling_sigma")
    }
    # How far the polygon's walls are from the camera, along their normals
    start, end = fit.polygon, np.roll(fit.polygon, -1, axis=0)
    area = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
    distance = area / np.maximum(np.hypot(*(end - start).T), 1e-9)
    proud = SKIRTING_DEPTH * moves.skirting / np.maximum(np.abs(distance), 0.3)
    floor_edge = np.tan(-(sight.floor_rad + floor_at)) * (1 - proud[sight.wall])
    floor = np.where(floor_found, floor_edge, around["floor"])
    ceiling = np.where(ceiling_found, np.tan(sight.ceiling_rad + ceiling_at), around["ceiling"])
    at_floor, at_ceiling = (EDGE_SIGMA_RAD / np.cos(edge) ** 2 for edge in (sight.floor_rad, sight.ceiling_rad))
    floor_sigma = np.where(floor_found, at_floor, around["floor_sigma"] * often * 2)
    ceiling_sigma = np.where(ceiling_found, at_ceiling, around["ceiling_sigma"] * often * 2)
    ends = np.zeros(AZIMUTHS), fit.outline.ratio * math.exp(moves.ratio_shift), columns.ratio_spread
    return Columns(sight.azimuth_rad, floor, floor_sigma, ceiling, ceiling_sigma, *ends), (floor_found, ceiling_found)
