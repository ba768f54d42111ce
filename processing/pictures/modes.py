"""What all pixels of a picture may be wrong by together: a few modes, each one standard deviation of one cause.

A pixel's own uncertainty averages out over many pixels; a wrong curve, time, lens or scale does not. A mode is the
relative error of luminance that one cause makes, as a function of level, colour, the side of a two-lens camera or the
angle from the axis, so that it takes a few numbers beside the picture (its attributes) whatever the picture's size.
Modes are independent: the variance of a sum over pixels is the sum of its squared sums over each mode (GUM 5.2).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal, Self

import cv2
import numpy as np

from processing.ground.arrays import Doubles, Floats, bands
from processing.ground.threads import side_by_side
from processing.pictures.images import LuminanceImage, P, RelativeImage, Validity, luminance_cd_m2
from processing.sphere import Equirectangular, Fisheye, Geometry, directions
from processing.sphere.geometry import polar_of_radius

KEY, SEAM_KEY = "shared_modes", "seam_sigma"
ROWS_AT_ONCE = 256  # of which directions are worked out; chosen: 50 MB of the largest frames
Kind = Literal["level", "seam", "axis", "whole", "scatter", "colour"]
LEVEL_SHIFT = 20  # bits of a float32, dropped: what is left steps by an eighth of an octave
LEVELS = 1 << (32 - LEVEL_SHIFT)
SEAM_SIGMA = 0.02  # half the difference in exposure of two lenses of one body; chosen: 0.06 stop, thrice a shutter's
SPECTRAL_SIGMA = 0.025
"""Relative error of luminance a unit of blueness from the light of the scale, by cameras', filters' and meters'
spectra: chosen on rigs of measured sensitivities (`benchmarks.hostile.spectra`, validation seeds)."""
ROOM_SPECTRAL_SIGMA = 0.05
"""The same of rooms, of daylight and lamps: 0.025 covered 82 % of their planes, this 91; with an ideal meter 97."""
MODELLED, SHARED_OF_MODELLED = "modelled light", 0.7  # of it: holds 19 of 20 sums over four validation rooms
MODELLED_CELLS = (32, 64)  # rows and columns of the map of such errors; chosen: 20 kB beside a picture


@dataclass(frozen=True)
class SharedMode:
    """One cause."""

    name: str
    kind: Kind
    places: tuple[float, ...]
    """Where `values` are: log2 luminance, or sine of the angle from the picture's axis; of a seam (-1, 1). Of scatter:
    rows and columns of its map, and its relative error where the picture's scale was measured. Of colour: `blueness` of
    no error, the value being the error a unit of it."""
    values: tuple[float, ...]
    """Relative error of luminance for one standard deviation; of scatter its luminance, row by row."""

    def moved(self, octaves: float, anchor: float | None = None) -> Self:
        """Return the mode of the picture times 2^octaves; with ``anchor`` (log2 luminance) it is 0 there: known."""
        if self.kind == "scatter":
            return replace(self, values=tuple(2**octaves * value for value in self.values))
        if self.kind != "level":
            return self
        moved = replace(self, places=tuple(place + octaves for place in self.places))
        return moved if anchor is None else moved.less(float(np.interp(anchor, moved.places, self.values)))

    def less(self, known: float) -> Self:
        """Return the mode less its relative error where the picture's scale was measured: that light is known."""
        if self.kind == "scatter":
            return replace(self, places=(*self.places[:2], self.places[2] + known))
        if self.kind == "colour":
            return replace(self, places=(self.places[0] + known / self.values[0],))
        return replace(self, values=tuple(value - known for value in self.values))

    def of_levels(self, luminance: Floats) -> Floats:
        """Return the relative error of pixels by their luminance (any shape, the same shape comes back)."""
        table = _by_bits(np.array(self.places), np.array(self.values))
        bits = np.ascontiguousarray(np.maximum(luminance, np.float32(1e-30)), dtype=np.float32).view(np.uint32)
        return np.asarray(table[bits >> np.uint32(LEVEL_SHIFT)])


def together(modes: Sequence[SharedMode], luminance: Floats) -> Floats:
    """Return the root of the summed squares of level modes for pixels of a luminance, of the same shape."""
    if not modes:
        return np.zeros_like(luminance)
    size = np.sqrt(np.square([mode.values for mode in modes]).sum(axis=0))
    return SharedMode("all", "level", modes[0].places, tuple(size.tolist())).of_levels(luminance)


def _by_bits(places: Doubles, values: Doubles) -> Floats:
    """Return values by the upper bits of a float32: sign, exponent and three bits of the fraction."""
    upper = np.arange(LEVELS, dtype=np.uint32)
    good = (upper > 0) & (upper < (0x7F800000 >> LEVEL_SHIFT))
    bits = np.where(good, (upper << np.uint32(LEVEL_SHIFT)) | np.uint32(1 << (LEVEL_SHIFT - 1)), np.uint32(0x3F800000))
    log2 = np.log2(bits.astype(np.uint32).view(np.float32).astype(np.float64))
    return np.asarray(np.where(good, np.interp(log2, places, values), 0.0), dtype=np.float32)


def with_modes(attributes: Mapping[str, object], modes: Sequence[SharedMode]) -> dict[str, object]:
    """Return a picture's attributes with these modes instead of its own."""
    return {**attributes, KEY: [asdict(mode) for mode in modes]} if modes else dict(attributes)


def multiplied(image: P, factor: float) -> P:
    """Return the picture times a factor above 0, and its modes with it."""
    modes = [mode.moved(math.log2(factor)) for mode in modes_of(image)]
    return replace(image, rgb=image.rgb * np.float32(factor), attributes=with_modes(image.attributes, modes))


def modelled(image: LuminanceImage, before: Floats | float) -> LuminanceImage:
    """Return a picture with the shared part of what its uncertainty (H, W) has grown by since it was ``before``, alike.

    Of what was modelled, not measured: in cells, as a lens's scatter is; 0 where nothing was. An earlier one is gone.
    """
    was, error = np.broadcast_to(before, image.uncertainty.shape), np.empty_like(image.uncertainty)
    for rows in bands(len(error), 32):  # for the processor's cache
        grown = np.square(np.minimum(image.uncertainty[rows], 1)) - np.square(np.minimum(was[rows], 1))
        error[rows] = SHARED_OF_MODELLED * np.sqrt(np.maximum(grown, 0)) * luminance_cd_m2(image.rgb[rows])
    height, width = (min(size, most) for size, most in zip(error.shape, MODELLED_CELLS, strict=True))
    cells = cv2.resize(error, (width, height), interpolation=cv2.INTER_AREA)
    values = tuple(float(f"{value:.4g}") for value in cells.ravel())
    mode = SharedMode(MODELLED, "scatter", (float(height), float(width), 0.0), values)
    others = [one for one in modes_of(image) if one.name != MODELLED]
    return replace(image, attributes=with_modes(image.attributes, [*others, mode]))


def widened(image: LuminanceImage, modes: Sequence[SharedMode]) -> LuminanceImage:
    """Return the picture with further modes, which each pixel's uncertainty then includes."""
    uncertainty = np.empty_like(image.uncertainty)

    def band(rows: slice) -> None:
        luminance, u2 = luminance_cd_m2(image.rgb[rows]), np.square(image.uncertainty[rows])
        for mode in modes:
            u2 += np.square(relative_error(mode, image, luminance, rows))
        np.sqrt(u2, out=uncertainty[rows])

    side_by_side(band, bands(len(uncertainty), ROWS_AT_ONCE))
    return carrying(replace(image, uncertainty=uncertainty), modes)


def carrying(image: LuminanceImage, modes: Sequence[SharedMode]) -> LuminanceImage:
    """Return the picture with further modes, which each pixel's uncertainty includes already."""
    return replace(image, attributes=with_modes(image.attributes, [*modes_of(image), *modes]))


def less_by_sum(modes: Sequence[SharedMode], image: LuminanceImage, weights: Doubles) -> list[SharedMode]:
    """Return modes less what they add to ``sum(weights * luminance)``, by which a picture was scaled; (H, W) both."""
    luminance = luminance_cd_m2(image.rgb)
    parts = weights * luminance / np.vdot(weights, luminance)
    return [mode.less(float(np.vdot(parts, relative_error(mode, image, luminance)))) for mode in modes]


def modes_of(image: RelativeImage | LuminanceImage) -> tuple[SharedMode, ...]:
    """Return a picture's modes; none where nothing is known."""
    rows = image.attributes.get(KEY, [])
    assert isinstance(rows, list | tuple)
    return tuple(SharedMode(row["name"], row["kind"], tuple(row["places"]), tuple(row["values"])) for row in rows)


def relative_error(
    mode: SharedMode, image: RelativeImage | LuminanceImage, luminance: Floats, rows: slice = slice(None)
) -> Floats:
    """Return a mode's relative error at each pixel of ``rows``, (H, W) of them, for one standard deviation.

    ``luminance`` (H, W): of those rows, in the picture's unit.
    """
    if mode.kind == "level":
        return mode.of_levels(luminance)
    if mode.kind == "whole":
        return np.full(luminance.shape, mode.values[0], np.float32)
    if mode.kind == "colour":
        return np.asarray(mode.values[0] * (blueness(image.rgb[rows]) - mode.places[0]), dtype=np.float32)
    if mode.kind == "scatter":
        light = _scattered(mode, image.rgb.shape[1], image.rgb.shape[0], rows)
        light /= np.maximum(luminance, np.float32(1e-30))
        # Where it is all there is, more of it is no news.
        return np.subtract(np.clip(light, -2, 2, out=light), mode.places[2], out=light)
    if mode.kind == "seam" and isinstance(image.geometry, Equirectangular):
        height, width = image.rgb.shape[:2]
        latitude = (0.5 - (np.arange(height)[rows] + 0.5) / height) * math.pi
        longitude = ((np.arange(width) + 0.5) / width - 0.5) * 2 * math.pi
        place = np.cos(latitude)[:, None] * np.cos(longitude)
    else:
        place = _place(mode.kind, image.geometry, rows)
    return np.asarray(np.interp(place, mode.places, mode.values), dtype=np.float32)


def _place(kind: Kind, geometry: Geometry, rows: slice) -> Doubles:
    """Return where rows' pixels look, (h, W): ahead, of a seam, else the sine of the angle from the axis."""
    if kind == "axis" and isinstance(geometry, Fisheye):
        across, down = geometry.offsets_px()
        radius = np.hypot(across, down[rows]) / geometry.radius_px
        return polar_of_radius(geometry, np.minimum(radius, 1.0))[0]
    rays = directions(geometry, rows)[0]
    return rays[..., 1] if kind == "seam" else np.hypot(rays[..., 0], rays[..., 1])


def level_error(image: LuminanceImage, levels: Doubles) -> float:
    """Return the standard uncertainty of a weighted sum over valid pixels' luminance by the modes that go by level.

    ``levels`` (LEVELS,): that sum by the upper bits of the pixels' luminance (float32, `LEVEL_SHIFT`).
    """
    found = (levels @ _by_bits(np.array(m.places), np.array(m.values)) for m in modes_of(image) if m.kind == "level")
    return math.hypot(*found)


def placed_parts(image: LuminanceImage, rows: slice) -> Iterator[Floats]:
    """Yield what each mode that goes by place adds to rows' valid luminance, shape (h, W), float32, in its unit.

    What the picture's scale adds (`LuminanceImage.scale_uncertainty`) is not in it. ``rows``: few at once.
    """
    luminance = luminance_cd_m2(image.rgb[rows])
    valid = luminance * (image.validity[rows] == Validity.VALID)
    for mode in modes_of(image):
        if mode.kind != "level":
            yield valid * relative_error(mode, image, luminance, rows)


def shared_errors(image: LuminanceImage, weights: Doubles) -> dict[str, float]:
    """Return the parts of both by cause, of ``sum(weights * luminance)``, in that sum's unit.

    Modes of one name, numbered, are one cause. ``weights``: (H, W).
    """
    luminance = luminance_cd_m2(image.rgb)
    parts, found = weights * luminance, dict[str, float]()
    for mode in modes_of(image):
        cause = mode.name.rstrip(" 0123456789")
        off = float(np.sum(parts * relative_error(mode, image, luminance)))
        found[cause] = math.hypot(found.get(cause, 0.0), off)
    return found


def _scattered(mode: SharedMode, width: int, height: int, rows: slice) -> Floats:
    """Return the light of a scatter mode at rows of a picture, (h, W), between its cells' middles."""
    cells = np.reshape(np.array(mode.values), (int(mode.places[0]), int(mode.places[1])))
    down = (between(height, cells.shape[0], rows) @ cells).astype(np.float32)
    return np.asarray(cv2.resize(down, (width, len(down)), interpolation=cv2.INTER_LINEAR), np.float32)


def between(size: int, count: int, part: slice = slice(None)) -> Doubles:
    """Return weights, shape (n, count), of cells for a part of ``size`` pixels, linear between the cells' middles."""
    places = np.clip((np.arange(size)[part] + 0.5) / size * count - 0.5, 0, count - 1)
    return np.asarray(np.maximum(1 - np.abs(places[:, None] - np.arange(count)), 0))


def blueness(rgb: Floats) -> Floats:
    """Return the log of blue over green, at most 3 either way, of light of shape (..., 3)."""
    blue, green = np.maximum(rgb[..., 2], np.float32(1e-20)), np.maximum(rgb[..., 1], np.float32(1e-20))
    return np.asarray(np.clip(np.log(blue / green), -3, 3), dtype=np.float32)


def colour_mode(light: float, *, indoors: bool = False) -> SharedMode:
    """Return the mode of spectra: of luminance from RGB, ``light`` being the blueness of what set the scale."""
    return SharedMode("spectra", "colour", (light,), (ROOM_SPECTRAL_SIGMA if indoors else SPECTRAL_SIGMA,))


def seam_mode(measured_rad: float | None, sigma: float = SEAM_SIGMA) -> SharedMode:
    """Return the mode of two lenses' exposures; ``measured_rad``: longitude of the spot that set the scale, if any."""
    own = 0.0 if measured_rad is None else math.copysign(sigma, math.cos(measured_rad))
    return SharedMode("stitching", "seam", (-0.1, 0.1), (-sigma - own, sigma - own))


def falloff_mode(sigma: float, measured_cos: float | None = None) -> SharedMode:
    """Return the mode of a lens's fall-off; ``sigma``: relative, at 90 degrees from the axis.

    ``measured_cos``: of a panorama of two lenses that look ahead and back, the cosine to their axis of what set the
    scale, where the fall-off is known.
    """
    if measured_cos is None:
        return SharedMode("fall-off", "axis", (0.0, 1.0), (0.0, sigma))
    places = np.linspace(-1, 1, 33)
    values = sigma * (np.sqrt(1 - places**2) - math.sqrt(1 - measured_cos**2))
    return SharedMode("fall-off", "seam", tuple(places.tolist()), tuple(values.tolist()))
