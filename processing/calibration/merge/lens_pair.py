"""Two lenses of one camera whose places are known: how bright each is, and one panorama of both.

Light is tied in the overlap, which both lenses see. How it falls off towards a lens's edge is taken from the camera's
own JPEG panorama, whose response curve is found together with it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from processing.calibration.merge.bracket import Merged, shares
from processing.calibration.merge.modes import local_contrast
from processing.ground.arrays import Bytes, Doubles, Floats, bands
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.ground.threads import side_by_side
from processing.pictures.images import RelativeImage, Validity
from processing.pictures.modes import SEAM_KEY, SEAM_SIGMA
from processing.sphere import Equirectangular, Fisheye, directions, pixels, point_directions
from processing.sphere.resampling import cubic_samples, linear_samples

SEEN_RAD = math.radians(84)
"""From a lens's axis: beyond, the camera's panorama may show the other lens's picture, from another point."""
RESAMPLED_SHARE = 0.6
"""Of the local contrast: what a sample between pixels, misplaced by a part of one, is off by. Chosen on six scenes."""
BLEND_RAD = math.radians(1.5)  # on each side of the seam; chosen: what is near the camera stands twice in it
TIE_PX = 384  # of a lens's picture, in which light is compared; chosen: half a degree hides what places are off by
CODES = (20, 235)  # of the JPEG, by which light is compared; chosen: clear of both ends
KNOTS = 12  # of the JPEG's response curve; chosen
FALLOFF = (2, 4, 6)  # powers of the angle from the axis over a right angle
PLAIN = 0.1  # of log light: standard deviation around a pixel whose light is compared; chosen
LEAST_LIGHT = 0.01  # of full scale, of light that is compared; chosen
LEAST_OVERLAP = 200  # pixels that both lenses see; chosen
SECTORS = 8  # of the seam; chosen
LEAST_SEAM = 0.002  # relative; chosen: a sensor's evenness
_ROWS = 128  # at a time, for memory


class PlacedLens(NamedTuple):
    """One lens."""

    geometry: Fisheye
    """Its picture within the whole raw picture."""
    axes: Doubles
    """(3, 3): the fisheye's axes in the panorama's, rows; the last is ahead."""
    exposure: float
    """Its light over what both together say."""


@dataclass(frozen=True)
class LensPair:
    """Both lenses of a camera."""

    lenses: tuple[PlacedLens, PlacedLens]
    falloff: Doubles
    """Log of what is left of light towards a lens's edge: factors of the powers `FALLOFF`."""
    seam_sigma: float
    """Relative standard uncertainty of each lens against both."""
    off_rad: float
    """Median distance of lens and panorama, of the worse lens."""

    def to_dict(self) -> dict[str, float]:
        """Return what was found, as the stage's metrics hold it."""
        first, second = (lens.exposure for lens in self.lenses)
        return {
            "second_stops": math.log2(second / first),
            "seam_sigma": self.seam_sigma,
            "edge_light": float(self.exposed(0, np.array(math.pi / 2))) / first,
            "off_deg": math.degrees(self.off_rad),
        }

    def exposed(self, number: int, angle_rad: Doubles) -> Doubles:
        """Return a lens's light over the scene's, by angles from its axis (any shape)."""
        return np.asarray(self.lenses[number].exposure * np.exp(_falls(angle_rad) @ self.falloff))


def stitched(merged: Merged, pair: LensPair, target: Equirectangular) -> Merged:
    """Return the panorama of a raw picture (H, 2 H) that was merged; its pixels are counted anew.

    Every direction is taken from the lens that sees it nearer its axis; beside the seam from both. Neighbouring wells
    are taken to err together. What the lenses still differ by goes along, for the mode of the seam.
    """
    image, shape = merged.image, (target.height_px, target.width_px)
    spread = np.minimum(np.square(image.uncertainty), np.float32(1e9))
    doubt = np.dstack([spread, image.validity == Validity.CLIPPED]).astype(np.float32)
    out, moved = np.zeros((*shape, 5), np.float32), np.zeros(shape, np.uint8)

    def band(rows: slice) -> None:
        rays = directions(target, rows)[0]
        angles = [np.arccos(np.clip(rays @ lens.axes[2], -1, 1)) for lens in pair.lenses]
        first = np.clip((angles[1] - angles[0]) / (4 * BLEND_RAD) + 0.5, 0, 1)
        for number, share in enumerate((first, 1 - first)):
            lens, here = pair.lenses[number], share > 0
            x, y, _ = pixels(lens.geometry, rays[here] @ lens.axes.T)
            at = (x - 0.5).astype(np.float32)[None], (y - 0.5).astype(np.float32)[None]
            light = cubic_samples(image.rgb, *at)[0] / pair.exposed(number, angles[number][here])[:, None]
            out[rows][here] += np.hstack([light, cubic_samples(doubt, *at)[0]]) * share[here, None]
            if image.ghost is not None:
                near = image.ghost[y.astype(int), x.astype(int)]
                moved[rows][here] = np.where(share[here] >= 0.5, near, moved[rows][here])

    side_by_side(band, bands(shape[0], _ROWS))
    rgb, clipped, ghost = np.ascontiguousarray(out[..., :3]), out[..., 4] > 0, None if image.ghost is None else moved
    validity = np.where(clipped, Validity.CLIPPED, np.where(out[..., 3] > 0.25, Validity.DARK, Validity.VALID))
    contrast = RESAMPLED_SHARE * local_contrast(np.asarray(rgb @ np.array(LUMINANCE_WEIGHTS, np.float32)))
    uncertainty = np.where(clipped, np.float32(np.inf), np.sqrt(out[..., 3] + np.square(contrast)))
    attributes = {**image.attributes, SEAM_KEY: pair.seam_sigma}
    made = RelativeImage(rgb, uncertainty, validity.astype(np.uint8), target, ghost, attributes)
    return Merged(made, replace(merged.report, shares=shares(made.validity, ghost, target)))


class _Compared(NamedTuple):
    """A lens's pixels whose light can be compared: log of it (N,), angle from the axis, what they see (N, 3)."""

    log: Doubles
    angle: Doubles
    rays: Doubles
    code: Doubles
    """(N, 3): of the panorama there."""


def tied(lenses: Sequence[PlacedLens], halves: Sequence[Floats], panorama: Bytes) -> LensPair:
    """Return the lenses with their exposures and fall-off.

    Log light is a function of the panorama's code and hue, of the angle, and of the lens as the panorama has it. What
    both lenses see then shows how they differ: the mean of sectors of the seam, which scatter by what is left.
    ``halves``: light (S, S) of full scale, inf where clipped; ``panorama``: (h, 2 h, 3) codes.
    """
    seen = [_compared(lens, half, k, panorama) for k, (lens, half) in enumerate(zip(lenses, halves, strict=True))]
    knots, tables, goals = np.linspace(*CODES, KNOTS), [], []
    for sign, one in zip((0.5, -0.5), seen, strict=True):
        use = (one.angle < SEEN_RAD) & (one.code > CODES[0]).all(axis=1) & (one.code < CODES[1]).all(axis=1)
        green, hue = one.code[use, 1], (one.code[use][:, ::2] - one.code[use, 1:2]) / 255
        hats = np.stack([np.interp(green, knots, row) for row in np.eye(KNOTS)], axis=1)
        tables.append(np.hstack([hats, hue, _falls(one.angle[use]), np.full((len(hats), 1), sign)]))
        goals.append(one.log[use])
    found = _robust(np.vstack(tables), np.concatenate(goals))
    falloff, apart, sigma = found[KNOTS + 2 : -1], float(found[-1]), SEAM_SIGMA
    ratio, first, second, around = _overlap(lenses, halves, seen[0])
    if len(ratio) >= LEAST_OVERLAP:
        rest = ratio - (_falls(first) - _falls(second)) @ falloff
        sector = np.floor((around / (2 * math.pi) + 0.5) * SECTORS).astype(int) % SECTORS
        middles = [float(np.median(rest[sector == k])) for k in np.unique(sector)]
        apart, sigma = float(np.mean(middles)), max(LEAST_SEAM, float(np.std(middles)) / 2)
    both = (lenses[0]._replace(exposure=math.exp(apart / 2)), lenses[1]._replace(exposure=math.exp(-apart / 2)))
    return LensPair(both, falloff, sigma, 0.0)


def _falls(angle_rad: Doubles) -> Doubles:
    """Return what `LensPair.falloff` counts, (..., P), at angles from the axis."""
    return powers(angle_rad / (math.pi / 2), FALLOFF)


def _robust(table: Doubles, goal: Doubles) -> Doubles:
    """Return factors (P,) of the columns of a table (N, P) that make ``goal`` (N,); by Huber 1964."""
    weights: Doubles = np.ones(len(goal))
    for _ in range(12):
        # What no row shows stays at 0.
        rows = np.vstack([table * weights[:, None], 1e-3 * np.eye(table.shape[1])])
        found = np.linalg.lstsq(rows, np.append(goal * weights, np.zeros(table.shape[1])), rcond=None)[0]
        left = np.abs(goal - table @ found)
        limit = 1.345 * 1.4826 * float(np.median(left)) if len(left) else 1.0
        weights = np.asarray(np.sqrt(np.minimum(1, limit / np.maximum(left, 1e-12))))
    return np.asarray(found)


def _compared(lens: PlacedLens, half: Floats, number: int, panorama: Bytes) -> _Compared:
    small = reduced(half, TIE_PX)
    small = np.where(np.isfinite(small), small, 0).astype(np.float32)
    y, x = np.mgrid[:TIE_PX, :TIE_PX] + 0.5
    scale = len(half) / TIE_PX
    local, seen = point_directions(lens.geometry, (x + number * TIE_PX) * scale, y * scale)
    rays = local @ lens.axes
    log = np.log(np.maximum(small, 1e-6))
    plain = cv2.blur(log * log, (3, 3)) - cv2.blur(log, (3, 3)) ** 2 < PLAIN**2
    angle = np.arccos(np.clip(local[..., 2], -1, 1))
    use = seen & plain & (small > LEAST_LIGHT)
    return _Compared(log[use].astype(np.float64), angle[use], rays[use], drawn(panorama, rays)[use].astype(np.float64))


def _overlap(
    lenses: Sequence[PlacedLens], halves: Sequence[Floats], first: _Compared
) -> tuple[Doubles, Doubles, Doubles, Doubles]:
    """Return of pixels that both see: log of the first's light over the second's, both angles, and where around."""
    lens, small = lenses[1], reduced(halves[1], TIE_PX)
    angle = np.arccos(np.clip(first.rays @ lens.axes[2], -1, 1))
    both = angle < lens.geometry.half_field_rad
    x, y, _ = pixels(lens.geometry, first.rays[both] @ lens.axes.T)
    scale = TIE_PX / len(halves[1])
    column, row = (x * scale - TIE_PX - 0.5).astype(np.float32)[None], (y * scale - 0.5).astype(np.float32)[None]
    light = linear_samples(np.where(np.isfinite(small), small, -1e3).astype(np.float32), column, row)[0]
    # Beyond a lens's half the other's begins.
    good = (light > LEAST_LIGHT) & (np.abs(np.stack([column, row]) - TIE_PX / 2) < TIE_PX / 2 - 1).all(axis=(0, 1))
    around = np.arctan2(*(first.rays[both] @ lenses[0].axes[:2].T).T)
    ratio = first.log[both] - np.log(np.maximum(light, 1e-6))
    return ratio[good], first.angle[both][good], angle[both][good], around[good]


def powers(values: Doubles, exponents: tuple[int, ...]) -> Doubles:
    """Return powers of values of any shape; the result has one axis more."""
    return np.stack([values**exponent for exponent in exponents], axis=-1)


def drawn(panorama: Bytes, rays: Doubles) -> Floats:
    """Return what the panorama shows along rays (S, S, 3), of their spacing: codes."""
    height = min(len(rays), panorama.shape[0])
    small = cv2.resize(panorama, (2 * height, height), interpolation=cv2.INTER_AREA).astype(np.float32)
    x, y, _ = pixels(Equirectangular(2 * height, height), rays)
    at = (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)
    return linear_samples(small, *at, border=cv2.BORDER_WRAP)


def reduced(half: Floats, size_px: int) -> Floats:
    """Return a lens's picture (S, S) of another size, the mean of its pixels."""
    return np.asarray(cv2.resize(half, (size_px, size_px), interpolation=cv2.INTER_AREA))
