"""Glare: daylight glare probability for an observer at the camera (Wienold and Christoffersen 2006), and indices.

DGP = 5.87e-5 Ev + 0.0918 log10(1 + sum L^2 w / (Ev^1.87 P^2)) + 0.16, with the vertical illuminance Ev at the eye and,
of each glare source, luminance L, solid angle w and position index P. It was found for 380 lx and more at the eye;
nothing is done about less, as in evalglare. P above the line of sight is Guth's (IES Lighting Handbook), below it
Iwata's.

A glare source is what is brighter than 2000 cd/m2 (evalglare's own threshold), with what lies within 0.2 rad of it;
the parts above 50,000 cd/m2, the sun and its mirror images, count as sources of their own.

Indices are of what one eye sees, as evalglare defines them, each with its uncertainty: Ev, L, w and P as above, Lb =
(Ev - sources') / pi the background. DGI: Hopkinson 1972; UGR: CIE 117; CGI: Einhorn 1979; VCP: Guth 1963; UGP: Hirning
2014; veiling luminance: Stiles and Holladay (CIE 146), what evalglare calls Lveil_cie.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from processing.calibration.scale.photometry import CLIPPED_SHARE, UP, luminance_map
from processing.errors import ParameterError
from processing.figures.uncertainty import Doubt, Figure, doubt_of
from processing.ground.arrays import Doubles, Indices
from processing.pictures.images import LuminanceImage, Validity
from processing.sphere import Equirectangular, Fisheye, directions, pixels, projected_solid_angles, solid_angles

THRESHOLD_CD_M2 = 2000.0  # evalglare's -b
PEAK_CD_M2 = 50_000.0  # evalglare's -Y
REACH_RAD = 0.2  # evalglare's -r
MOST_INDEX = 16.0  # evalglare's bound of P
FAINT_LX = 380.0  # at the eye, below which the formula was never tried

CLASSES = ((0.35, "imperceptible"), (0.40, "perceptible"), (0.45, "disturbing"), (math.inf, "intolerable"))
"""Upper ends of what observers say (Wienold 2009)."""

_GRID = Equirectangular(720, 360)  # on which neighbours are found: half a degree each


def bright_spots(
    rays: Doubles, luminance_cd_m2: npt.NDArray[np.floating], area_sr: Doubles, threshold_cd_m2: float | None = None
) -> Indices:
    """Return which source each pixel (H, W) belongs to, from 1; 0: it does not glare.

    ``rays``: directions (H, W, 3); luminance and solid angles (H, W). ``threshold_cd_m2`` None: 2000 cd/m2.
    """
    bright = (luminance_cd_m2 > (threshold_cd_m2 or THRESHOLD_CD_M2)) & (area_sr > 0)
    towards, peak = rays[bright], luminance_cd_m2[bright] > PEAK_CD_M2
    source = np.zeros(len(peak), np.intp)
    source[~peak] = 1 + linked(towards[~peak], REACH_RAD)
    source[peak] = 1 + source.max(initial=0) + linked(towards[peak], REACH_RAD)
    found = np.zeros(bright.shape, np.intp)
    found[bright] = source
    return found


def linked(rays: Doubles, reach_rad: float) -> Indices:
    """Return for directions (n, 3) the number of the group that each is in; groups lie more than ``reach_rad`` apart.

    To the half degree of a grid over the sphere. ``rays``: unit vectors of shape (N, 3).
    """
    from scipy.ndimage import label
    from scipy.spatial import cKDTree

    if not len(rays):
        return np.zeros(0, np.intp)
    row, column = pixel_of(_GRID, rays)
    used = np.zeros((_GRID.height_px, _GRID.width_px), bool)
    used[row, column] = True
    middles, _ = directions(_GRID)
    chord = 2 * math.sin(reach_rad / 4)
    far, _ = cKDTree(middles[used]).query(middles.reshape(-1, 3), distance_upper_bound=chord)
    labels, count = label(np.isfinite(far).reshape(used.shape), np.ones((3, 3)))
    _, number = np.unique(_joined(labels, count)[labels[row, column]], return_inverse=True)
    return np.asarray(number, dtype=np.intp)


def _joined(labels: npt.NDArray[np.integer], count: int) -> Indices:
    """Return the group of each label, joined over the seam and the poles."""
    group = np.arange(count + 1)
    pairs = [(labels[:, 0], labels[:, -1]), (labels[1:, 0], labels[:-1, -1]), (labels[:-1, 0], labels[1:, -1])]
    pairs += [(np.full_like(labels[pole], labels[pole].max()), labels[pole]) for pole in (0, -1)]
    for left, right in pairs:
        for a, b in zip(left, right, strict=True):
            if a and b and group[a] != group[b]:
                group[group == group[b]] = group[a]
    return group


def pixel_of(panorama: Equirectangular, rays: Doubles) -> tuple[Indices, Indices]:
    """Return rows and columns, of shape (...), of the pixels that directions (..., 3) fall into: edges stay sharp."""
    x, y, _ = pixels(panorama, rays)
    return y.astype(np.intp).clip(0, panorama.height_px - 1), x.astype(np.intp) % panorama.width_px


def probability(vertical_lx: float, sources: float) -> float:
    """Return DGP (0 to 1) of the illuminance at the eye and the sum of L^2 w / P^2 over sources."""
    if vertical_lx <= 0:
        return 0.0
    return min(5.87e-5 * vertical_lx + 0.0918 * math.log10(1 + sources / vertical_lx**1.87) + 0.16, 1.0)


def position_index(rays: Doubles) -> Doubles:
    """Return how little a source in each direction, ahead of the observer, disturbs: 1 ahead to 16, (N,).

    ``rays``: unit vectors (N, 3) to the observer's right, ahead and up.
    """
    ahead, aside, up = np.clip(rays[:, 1], 1e-9, 1), np.abs(rays[:, 0]), rays[:, 2]
    sigma = np.degrees(np.arccos(ahead))
    tau = np.degrees(np.arctan2(aside, up))
    steep = (35.2 - 0.31889 * tau - 1.22 * np.exp(-2 * tau / 9)) / 1000 * sigma
    guth = np.exp(steep + (21 + 0.26667 * tau - 0.002963 * tau**2) / 100_000 * sigma**2)
    away = np.hypot(aside, up) / ahead
    iwata = 1 + np.where(away > 0.6, 1.2, 0.8) * np.minimum(away, 3)
    return np.asarray(np.minimum(np.where(up < 0, iwata, guth), MOST_INDEX))


TASK_FACTOR = 5.0  # times the task's mean luminance above which a pixel may glare (evalglare's -b with -T)
_NEAR_DEG = 1.0  # chosen: nearer to the line of sight the formula of veiling light has no meaning
Task = tuple[float, float, float]  # right and up of the line of sight, and the cone's whole angle, degrees


def glare_indices(
    image: LuminanceImage, azimuths_rad: Sequence[float] = (0.0,), *, task: Task | None = None
) -> list[dict[str, Figure]]:
    """Return each index for observers who look level towards azimuths of a panorama, or along the axis of a fisheye.

    Uncertainties are of the scale, shared modes and pixels' noise with the sources as the picture shows them, and of
    what would be one too, or no longer, were all luminances off together. Where a source is clipped indices are bounds.
    Raises `ParameterError` for other pictures, or a task that the picture does not show.
    """
    geometry, level = image.geometry, luminance_map(image)
    rays, _ = directions(replace(geometry, top_azimuth_rad=0.0) if isinstance(geometry, Fisheye) else geometry)
    area = np.where(image.validity == Validity.OUTSIDE, 0.0, solid_angles(geometry))
    if isinstance(geometry, Fisheye):
        rays, azimuths_rad = np.stack([-rays[..., 0], rays[..., 2], rays[..., 1]], axis=-1), (0.0,)
        area = np.where(rays[..., 1] > 0, area, 0.0)
    elif not isinstance(geometry, Equirectangular):
        raise ParameterError("glare indices need a panorama, or a fisheye picture at the eye", advice="give --view")
    looks = [_looking(geometry, azimuth, area) for azimuth in azimuths_rad]
    threshold = None if task is None else _task_threshold(rays, level, area, task)

    def eyes(change: float) -> list[_Eye]:
        sources = bright_spots(rays, level * np.float32(change), area, threshold).ravel()
        return [_Eye.of(look, rays.reshape(-1, 3), sources) for look in looks]

    plain = eyes(1.0)
    doubt = doubt_of(image, lambda light: np.concatenate([eye.sums(light) for eye in plain]))
    shifts = np.split(doubt.shifts, np.cumsum([2 + 5 * len(eye.area) for eye in plain])[:-1], axis=1)
    # By how much all luminances may be off together; the scale moves a task's threshold as it moves the light.
    off = math.hypot(*shifts[0][: -1 if task else None, 1]) / max(float(plain[0].sums(level)[1]), 1e-30)
    others = [eyes(1 + sign * min(off, 0.5)) for sign in (-1, 1)]
    return [eye.figures(image, doubt, shifts[n], [one[n] for one in others]) for n, eye in enumerate(plain)]


class _Look(NamedTuple):
    """What lies ahead of an observer: which pixels of the flattened picture (n,), their solid angles and the same
    projected onto the plane of the eye, steradians; and (3, 3) from the picture's rays to the right, ahead and up."""

    where: Indices
    solid: Doubles
    facing: Doubles
    turn: Doubles


def _looking(geometry: Fisheye | Equirectangular, azimuth_rad: float, area: Doubles) -> _Look:
    sine, cosine = math.sin(azimuth_rad), math.cos(azimuth_rad)
    facing = projected_solid_angles(geometry, UP if isinstance(geometry, Fisheye) else (sine, cosine, 0.0))
    where = np.flatnonzero((facing > 0) & (area > 0))
    turn = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])
    return _Look(where, area.ravel()[where], facing.ravel()[where], turn)


@dataclass(frozen=True)
class _Eye:
    """What one observer sees: sums of its light, by source too, and the indices that they make."""

    look: _Look
    bright: Indices
    """(B,): those of the look's pixels that glare; and the source of each, from 0."""
    source: Indices
    weights: Doubles
    """(B, 5): their projected solid angles, solid angles, and these times their ways to the right, ahead and up."""
    area: Doubles
    """Of each source (S,), steradians."""

    @classmethod
    def of(cls, look: _Look, rays: Doubles, sources: Indices) -> "_Eye":
        """Return the eye for a flattened picture's rays and sources."""
        numbers = sources[look.where]
        bright = np.flatnonzero(numbers)
        source = np.unique(numbers[bright], return_inverse=True)[1]
        facing, solid, ways = look.facing[bright], look.solid[bright], rays[look.where[bright]] @ look.turn
        weights = np.column_stack([facing, solid, solid[:, None] * ways])
        return cls(look, bright, source, weights, np.bincount(source, solid).astype(np.float64))

    def sums(self, light: npt.NDArray[np.floating]) -> Doubles:
        """Return light (H, W) by projected and by plain solid angle, and by `weights` of each source, (2 + 5 S,)."""
        seen = light.ravel()[self.look.where].astype(np.float64)
        each = [np.bincount(self.source, part * seen[self.bright]) for part in self.weights.T]
        return np.concatenate([[self.look.facing @ seen, self.look.solid @ seen], np.stack(each, axis=-1).ravel()])

    def noise(self, variance: Doubles) -> Doubles:
        """Return independent changes of `sums` by noise, (C, K): roots of covariances of sources and of the rest."""
        seen = variance.ravel()[self.look.where]
        both = np.stack([self.look.facing, self.look.solid])
        rows = [np.zeros(2 + 5 * len(self.area))]
        # The two sums of what is no source are taken to change together.
        rows[0][:2] = np.sqrt(np.maximum(both**2 @ seen - self.weights[:, :2].T ** 2 @ seen[self.bright], 0))
        spread = self.weights * np.sqrt(seen[self.bright, None])
        for n in range(len(self.area)):
            root = np.asarray(np.linalg.qr(spread[self.source == n], mode="r"))
            more = np.zeros((len(root), len(rows[0])))
            more[:, :2], more[:, 2 + 5 * n : 7 + 5 * n] = root[:, :2], root
            rows.extend(more)
        return np.array(rows)

    def values(self, sums: Doubles) -> dict[str, float]:
        """Return the indices of `sums`."""
        (lux, total), each = np.maximum(sums[:2], 0), sums[2:].reshape(-1, 5)
        direct, light = np.maximum(each[:, :2].T, 0)
        ways = each[:, 2:] / np.maximum(np.linalg.norm(each[:, 2:], axis=1, keepdims=True), 1e-30)
        level, cosine = light / self.area, np.clip(direct / np.maximum(light, 1e-30), 0, 1)
        mean = float(total / max(self.look.solid.sum(), 1e-9))
        angle = np.degrees(np.arccos(np.clip(ways[:, 1], 0, 1)))
        found = _formulas((level, self.area, position_index(ways), cosine, angle), float(lux), mean)
        counted = {"sources": float(len(level)), "brightest_cd_m2": float(level.max(initial=0.0))}
        return {"ev_lx": float(lux), "mean_cd_m2": mean, **found, **counted}

    def figures(
        self, image: LuminanceImage, doubt: Doubt, shifts: Doubles, others: Sequence["_Eye"]
    ) -> dict[str, Figure]:
        """Return the indices; ``shifts`` (C, K): of these sums, ``others``: eyes with other sources."""
        level, clipped = luminance_map(image), (image.validity == Validity.CLIPPED).ravel()[self.look.where]
        sums = self.sums(level)
        plain = self.values(sums)
        moved = [self.values(sums + shift) for shift in (*shifts, *self.noise(doubt.variance))]
        apart = [eye.values(eye.sums(level)) for eye in others]
        lost = self.look.facing[clipped] @ level.ravel()[self.look.where[clipped]]
        low = lost > CLIPPED_SHARE * plain["ev_lx"] or 1 - self.look.facing.sum() / math.pi > CLIPPED_SHARE
        light, index = "lower" if low else None, "lower" if low or clipped[self.bright].any() else None
        bounds = {"ev_lx": light, "mean_cd_m2": light, "vcp_pct": index and "upper", "sources": None}
        found = {}
        for name, value in plain.items():
            parts = [*(one[name] - value for one in moved), max(abs(one[name] - value) for one in apart)]
            found[name] = doubt.figure(value, parts, bounds.get(name, index))
        return found


def _task_threshold(rays: Doubles, level: np.ndarray, area: Doubles, task: Task) -> float:
    right, up, across = (math.radians(value) for value in task)
    towards = np.array([math.sin(right) * math.cos(up), math.cos(right) * math.cos(up), math.sin(up)])
    inside = (rays @ towards >= math.cos(across / 2)) & (area > 0)
    if not inside.any():
        raise ParameterError("the picture lacks the task's zone", advice="give --task RIGHT,UP,ACROSS in degrees")
    return TASK_FACTOR * float(np.sum(level[inside] * area[inside]) / np.sum(area[inside]))


def _formulas(sources: tuple[Doubles, ...], lux: float, mean: float) -> dict[str, float]:
    level, area, index, cosine, angle = sources
    direct = float(np.sum(level * area * cosine))
    back = max((lux - direct) / math.pi, 1e-6)
    weighed = float(np.sum(level**2 * area / index**2))
    dgi = 0.478 * np.sum(level**1.6 * area**0.8 / index**1.6 / (back + 0.07 * np.sqrt(area) * level))
    cgi = 2 * (1 + direct / 500) / max(direct + math.pi * back, 1e-6) * weighed
    shape = 20.4 * area + 1.52 * area**0.2 - 0.075
    sensation = float(np.sum(0.5 * level * shape / (index * max(mean, 1e-6) ** 0.44)))
    veil = 10 * np.sum(np.where(angle > _NEAR_DEG, level * area * cosine / np.maximum(angle, _NEAR_DEG) ** 2, 0))
    return {
        "dgp": probability(lux, weighed),
        "dgi": _log(10, float(dgi)),
        "ugr": _log(8, 0.25 / back * weighed),
        "cgi": _log(8, cgi),
        "vcp_pct": _comfort(sensation, len(level)),
        "ugp": max(_log(0.26, 0.25 / back * weighed), 0.0),
        "lveil_cd_m2": float(veil),
    }


def _log(factor: float, value: float) -> float:
    return factor * math.log10(value) if value > 1e-9 else 0.0


def _comfort(sensation: float, count: int) -> float:
    """Return how many of a hundred are not disturbed."""
    if count == 0 or sensation <= 0:
        return 100.0
    rating = sensation ** (count**-0.0914)
    return 50 * (1 + math.erf((6.374 - 1.3227 * math.log(rating)) / math.sqrt(2)))
