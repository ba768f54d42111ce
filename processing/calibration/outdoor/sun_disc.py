"""The sun in an outdoor picture: where it stands, whether it is clipped or cut, and what it gives.

Unclipped, its place is the centroid of the light over its surroundings. Clipped, every frame is white there, often
wider than the disc: the centre of the white spot. Cut by the edge of the field: a disc fitted to the part that shows.
"""

import math
from dataclasses import dataclass

import numpy as np

from processing.errors import SunError
from processing.ground.arrays import Doubles, Flags, Floats, Vector
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Fisheye, directions

SUN_RADIUS_RAD = math.radians(0.533 / 2)  # mean over the year; it varies by 1.7 %
SUN_SOLID_ANGLE_SR = 2 * math.pi * (1 - math.cos(SUN_RADIUS_RAD))  # 6.8e-5
_LEAST_CONTRAST = 50.0  # of a sun, 0.533 degrees wide, over the median of the sky. Bright cloud edges reach 5
_LEAST_SHARE = 0.5  # of the light within three radii that a sun holds within one
_WIDEST_SPOT_RAD = math.radians(4)  # across a clipped spot that can be a sun with its glare
_LEAST_ROUND = 0.4  # chosen


@dataclass(frozen=True)
class Sun:
    """A sun that was found, in the geometry's world axes."""

    direction: Vector
    sigma_rad: float
    """Standard uncertainty of the direction along each of two axes, from the picture alone (not the lens's model)."""
    clipped: bool
    cut: bool
    """Part of the disc lies outside the field."""
    rows: slice
    columns: slice
    """The window around it, a few degrees wide."""

    @property
    def azimuth_rad(self) -> float:
        """Return the azimuth from +y towards +x, in -pi..pi."""
        return math.atan2(self.direction[0], self.direction[1])

    @property
    def elevation_rad(self) -> float:
        """Return the elevation over the horizon."""
        return math.atan2(self.direction[2], math.hypot(self.direction[0], self.direction[1]))


@dataclass(frozen=True)
class Window:
    """A small part of a picture: what each pixel sees, how large it is, and its luminance."""

    rows: slice
    columns: slice
    ways: Doubles
    """(h, w, 3)."""
    pixel_sr: Doubles
    luminance: Doubles
    inside: Flags
    clipped: Flags

    def angle_from(self, direction: Doubles) -> Doubles:
        """Return the angle (h, w) of each pixel's centre from a direction.

        ``direction``: unit vector of shape (3,); angles in rad.
        """
        chord = np.linalg.norm(self.ways - direction, axis=-1)
        return np.asarray(2 * np.arcsin(np.clip(chord / 2, 0, 1)))


def find_sun(image: RelativeImage | LuminanceImage) -> Sun:
    """Return the sun of a fisheye or equirectangular picture of the sky.

    Raises `SunError` where there is none: overcast, at night, hidden, or clipped together with half of the sky.
    """
    luminance = luminance_cd_m2(image.rgb)
    inside = (image.validity != Validity.OUTSIDE) & _field(image)
    if not inside.any():
        raise _no_sun("no part of the picture lies inside the field of view")
    clipped = image.validity == Validity.CLIPPED
    sky = float(np.median(luminance[inside]))
    row, column = _brightest(luminance, inside, clipped)
    window = window_at(image, row, column)
    return _clipped_sun(window) if clipped[row, column] else _open_sun(window, sky, (row, column))


def window_at(image: RelativeImage | LuminanceImage, row: int, column: int) -> Window:
    """Return the part of a picture a few degrees around a pixel."""
    height, width = image.rgb.shape[:2]
    pixel_rad = _pixel_rad(image, row, column)
    reach = math.ceil(_WIDEST_SPOT_RAD / pixel_rad) + 3
    rows = slice(max(row - reach, 0), min(row + reach + 1, height))
    columns = slice(max(column - reach, 0), min(column + reach + 1, width))
    if isinstance(image.geometry, Equirectangular) and (
        columns.stop - columns.start < 2 * reach + 1 or abs(0.5 - (row + 0.5) / height) * math.pi > math.radians(60)
    ):
        columns = slice(0, width)  # the window goes on at the other side, or around the pole
    ways, seen = directions(image.geometry, rows)
    ways, seen = ways[:, columns], seen[:, columns]
    part = (rows, columns)
    inside = (image.validity[part] != Validity.OUTSIDE) & seen
    return Window(
        rows,
        columns,
        ways,
        _pixel_sr(ways, seen),
        luminance_cd_m2(image.rgb[part]).astype(np.float64),
        inside,
        image.validity[part] == Validity.CLIPPED,
    )


def _field(image: RelativeImage | LuminanceImage) -> Flags:
    """Return which pixels (H, W) a fisheye's field holds; of other pictures all."""
    lens = image.geometry
    if not isinstance(lens, Fisheye):
        return np.ones(image.validity.shape, dtype=bool)
    across, down = lens.offsets_px()
    return np.asarray(across**2 + down**2 < lens.radius_px**2)


def _brightest(luminance: Floats, inside: Flags, clipped: Flags) -> tuple[int, int]:
    """Return row and column of the sun's candidate: in the clipped spot with most light, else the brightest pixel."""
    if not (clipped & inside).any():
        at = int(np.where(inside, luminance, -1).argmax())
        width = int(luminance.shape[1])
        return at // width, at % width
    import cv2

    _, labels = cv2.connectedComponents((clipped & inside).astype(np.uint8), connectivity=8)
    light = np.bincount(labels.ravel(), weights=luminance.ravel())
    light[0] = -1
    rows, columns = np.nonzero(labels == int(light.argmax()))
    middle = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
    return int(rows[middle]), int(columns[middle])


def _open_sun(window: Window, sky: float, at: tuple[int, int]) -> Sun:
    """Return an unclipped sun: the centroid of what is brighter than its surroundings."""
    centre = window.ways[at[0] - window.rows.start, at[1] - window.columns.start]
    pixel_rad = math.sqrt(float(np.median(window.pixel_sr[window.inside])))
    reach = SUN_RADIUS_RAD + 1.5 * pixel_rad
    # The sky's luminance beside the sun
    angle = window.angle_from(centre)
    ring = window.inside & (angle > 1.5 * reach) & (angle < 4 * reach)
    surround = float(np.median(window.luminance[ring])) if ring.any() else 0.0
    light = np.where(window.inside, np.maximum(window.luminance - surround, 0), 0) * window.pixel_sr
    for _ in range(4):
        weight = np.where(window.angle_from(centre) < reach, light, 0)
        if weight.sum() <= 0:
            raise _no_sun("nothing in the picture is brighter than its surroundings")
        centre = _unit(np.einsum("hw,hwc->c", weight, window.ways))
    angle = window.angle_from(centre)
    given = float(light[angle < reach].sum())
    around = float(light[angle < 3 * reach].sum())
    if given / SUN_SOLID_ANGLE_SR < _LEAST_CONTRAST * max(sky, 1e-12):
        raise _no_sun("nothing in the picture is bright and small enough")
    if given < _LEAST_SHARE * around:
        raise _no_sun("the brightest spot is wider than the sun")
    cut = bool((~window.inside & (angle < SUN_RADIUS_RAD + pixel_rad)).any())
    if cut:
        over = np.where(angle < 2 * reach, light / np.maximum(window.pixel_sr, 1e-12), 0)
        centre = _fit_disc(window, centre, over, free_radius=False)
    sigma = _cut_sigma(pixel_rad) if cut else _centroid_sigma(pixel_rad)
    return _sun(window, centre, sigma, clipped=False, cut=cut)


def _clipped_sun(window: Window) -> Sun:
    """Return a clipped sun: the middle of the white spot around the window's middle."""
    import cv2

    spot = window.clipped & window.inside
    _, labels = cv2.connectedComponents(spot.astype(np.uint8), connectivity=8)
    share = np.bincount(labels.ravel(), weights=(window.luminance * window.pixel_sr).ravel())
    share[0] = -1
    spot = labels == int(share.argmax())
    area = float(window.pixel_sr[spot].sum())
    ways = window.ways[spot]
    across = 2 * float(np.max(window.angle_from(_unit(ways.mean(axis=0)))[spot])) + math.sqrt(area / spot.sum())
    touches = bool(cv2.dilate(spot.astype(np.uint8), np.ones((3, 3), np.uint8))[~window.inside].any())
    roundness = area / (math.pi / 4 * across**2)
    if across > _WIDEST_SPOT_RAD or (roundness < _LEAST_ROUND and not touches):
        raise _no_sun("what is clipped is not a small round spot", likely="bright clouds clipped in every frame")
    centre = _unit(np.einsum("n,nc->c", window.pixel_sr[spot], ways))
    pixel_rad = math.sqrt(float(np.median(window.pixel_sr[window.inside])))
    if touches:
        centre = _fit_disc(window, centre, spot.astype(np.float64), free_radius=True)
    glare = max(0.0, math.sqrt(area / math.pi) - SUN_RADIUS_RAD)
    sigma = 0.2 * pixel_rad + 0.1 * glare
    return _sun(window, centre, sigma + touches * _cut_sigma(pixel_rad), clipped=True, cut=touches)


def _fit_disc(window: Window, start: Doubles, shape: Doubles, *, free_radius: bool) -> Doubles:
    """Return the centre of the disc that best explains a spot of which a part lies outside the field."""
    from scipy.optimize import least_squares

    # Two unit vectors across the start
    side = np.cross(start, (0.0, 0.0, 1.0) if abs(start[2]) < 0.9 else (1.0, 0.0, 0.0))
    side = side / np.linalg.norm(side)
    other = np.cross(start, side)
    pixel_rad = math.sqrt(float(np.median(window.pixel_sr[window.inside])))
    level = float(np.percentile(shape[shape > 0], 75)) if (shape > 0).any() else 1.0
    scale = np.array([SUN_RADIUS_RAD, SUN_RADIUS_RAD, 1.0, SUN_RADIUS_RAD])

    def centre_of(unknown: Doubles) -> Doubles:
        return _unit(start + unknown[0] * scale[0] * side + unknown[1] * scale[1] * other)

    def residuals(unknown: Doubles) -> Doubles:
        radius = SUN_RADIUS_RAD * (unknown[3] if free_radius else 1.0)
        cover = np.clip(0.5 + (radius - window.angle_from(centre_of(unknown))) / pixel_rad, 0, 1)
        return np.asarray(((unknown[2] * cover - shape / level) * window.inside)[window.inside])

    found = least_squares(residuals, [0.0, 0.0, 1.0, 1.0], bounds=([-3, -3, 0.3, 0.7], [3, 3, 3.0, 8.0]))
    return centre_of(found.x)


def _centroid_sigma(pixel_rad: float) -> float:
    """Return the uncertainty of a centroid of pixels: small where the disc covers several, else that of one pixel."""
    across = 2 * SUN_RADIUS_RAD / pixel_rad
    return pixel_rad * (0.29 * max(0.0, 1 - across) + 0.05 / max(across, 1.0) + 0.01)


def _cut_sigma(pixel_rad: float) -> float:
    """Return the uncertainty of a disc of which a part is seen: of half its radius, or a pixel's half."""
    return max(SUN_RADIUS_RAD / 2, 0.6 * pixel_rad)


def _sun(window: Window, centre: Doubles, sigma: float, *, clipped: bool, cut: bool) -> Sun:
    x, y, z = (float(v) for v in centre)
    return Sun((x, y, z), sigma, clipped, cut, window.rows, window.columns)


def _pixel_rad(image: RelativeImage | LuminanceImage, row: int, column: int) -> float:
    """Return the angle from a pixel to the next row's."""
    height = int(image.rgb.shape[0])
    first = min(max(row - 1, 0), max(height - 2, 0))
    ways, _ = directions(image.geometry, slice(first, min(first + 2, height)))
    if len(ways) < 2:
        return math.pi / max(height, 1)
    return max(float(np.linalg.norm(ways[1, column] - ways[0, column])), 1e-5)


def _pixel_sr(ways: Doubles, seen: Flags) -> Doubles:
    """Return each pixel's solid angle (h, w) from its neighbours' directions; 0 where nothing is seen."""
    if min(ways.shape[:2]) < 2:
        return np.where(seen, SUN_SOLID_ANGLE_SR, 0.0)
    across, down = np.gradient(ways, axis=1), np.gradient(ways, axis=0)
    area = np.linalg.norm(np.cross(across, down), axis=-1)
    # At the field's edge a neighbour may see nothing: take the typical size there.
    whole = seen.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            whole &= np.roll(seen, step, axis)
    typical = float(np.median(area[whole])) if whole.any() else 0.0
    return np.where(whole, area, np.where(seen, typical, 0.0))


def _unit(vector: Doubles) -> Doubles:
    return np.asarray(vector / np.linalg.norm(vector))


def _no_sun(what: str, likely: str = "an overcast sky, night, or an obstructed sun") -> SunError:
    return SunError(f"no sun: {what}", likely=likely, advice="use the recorded heading for north")
