"""k1: from a meter reading to the scale of the indoor picture (Ji et al. 2023, eq. 1).

k1 is the luminance that the meter read over the luminance that the picture displays for the same target, averaged
over the meter's spot. Its relative standard uncertainty has the parts ``meter``, ``spot``, ``picture`` and ``drift``,
independent of one another and added in quadrature (GUM, JCGM 100:2008, 5.1.2).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from processing.errors import ScaleError
from processing.ground.arrays import Doubles, Indices, bands
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import ROWS_AT_ONCE, modes_of, together, with_modes
from processing.sphere import Equirectangular, Fisheye, Geometry, pixels
from station.session.session import FrameRecord, ReadingRecord

DRIFT_WARNING_FRAC, SPOT_WARNING_FRAC = 0.05, 0.02  # chosen
MAX_GHOST_SHARE = 0.25  # of the spot: more means that something stood before the target
CURVE_FRAC = 0.004
"""Relative standard uncertainty that pixels of equal codes share: of 0.006 stop, what a recovered curve is held to."""
NEIGHBOURS = 4.0  # pixels whose noise is one: JPEG and demosaicing share it among neighbours
LEAST_UNCERTAINTY = 0.001  # relative, of a pixel whose shared errors are known; chosen
ONE_BOOT_S = 2.0  # chosen: UTC and monotonic time part by less in a capture, whose UTC follows monotonic time
_USABLE = ("ok", "typed")


@dataclass(frozen=True)
class MeterAccuracy:
    """Half-widths of a meter's error: relative, and in steps of the last digit shown; its spot; how well it is aimed.

    The defaults are the class of an LS-160 (2 % and 2 digits, spot 1/3 degree); 0.2 degrees is what a careful person
    reaches who points at a mark. A half-width w is a standard uncertainty of w / sqrt(3) (GUM 4.3.7).
    ``spectral``: standard, relative, of light of other spectra than illuminant A, for which a maker states accuracy.
    The default is the root mean square of simulated meters under daylight (`benchmarks.hostile.spectra`).
    """

    relative: float = 0.02
    digits: float = 2.0
    spot_rad: float = math.radians(1 / 3)
    pointing_rad: float = math.radians(0.2)
    spectral: float = 0.012


LS160 = MeterAccuracy()


@dataclass(frozen=True)
class ScaleFactor:
    """A factor on a picture's values, with its uncertainty and where that comes from."""

    value: float
    relative_uncertainty: float
    """Standard (1 sigma)."""
    parts: Mapping[str, float] = field(default_factory=dict)
    """Relative standard uncertainties that ``relative_uncertainty`` is made of."""
    n_pixels: float = 0.0
    """Pixels (with their parts) that the displayed value is the mean of."""
    displayed: float = 0.0
    """Luminance of the target in the picture's own scale."""
    measured: float = 0.0
    """What it was compared with: cd/m2 for k1, the other picture's value for k2."""
    drift_frac: float | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Measured:
    """The meter's value at the moment of the picture."""

    luminance_cd_m2: float
    meter_frac: float
    drift_frac: float | None
    drift_part: float


@dataclass(frozen=True)
class Spot:
    """A round part of the sphere: longitude (right of ahead) and latitude of its middle, and its width; radians."""

    longitude_rad: float
    latitude_rad: float
    diameter_rad: float = LS160.spot_rad

    def direction(self) -> Doubles:
        """Return the unit vector to its middle. Of shape (3,)."""
        flat = math.cos(self.latitude_rad)
        x, y = flat * math.sin(self.longitude_rad), flat * math.cos(self.longitude_rad)
        return np.array((x, y, math.sin(self.latitude_rad)))


@dataclass(frozen=True)
class SpotPixels:
    """The pixels that a spot touches, and the share of the spot that each covers (sum 1)."""

    row: Indices
    column: Indices
    share: Doubles

    def mean(self, plane: npt.NDArray[np.generic]) -> float:
        """Return the mean of a plane (H, W) over the spot."""
        return float(np.asarray(plane[self.row, self.column], dtype=np.float64) @ self.share)

    @property
    def n_effective(self) -> float:
        """Return how many whole pixels carry the mean."""
        return float(1 / np.sum(self.share**2))


def scale_from_reading(
    image: RelativeImage,
    readings: Sequence[ReadingRecord],
    longitude_rad: float,
    latitude_rad: float,
    *,
    frames: Sequence[FrameRecord] = (),
    meter: MeterAccuracy = LS160,
    repeat_frac: float = 0.0,
) -> ScaleFactor:
    """Return k1 from the meter's readings of a target in the picture.

    ``frames`` (those the picture was merged from) give its moment: between two readings the meter's value is
    interpolated to it, else it is their mean. Readings whose status is neither "ok" nor "typed" are not used.
    ``repeat_frac``: how much a stop that was repeated after them has changed, relative.

    Raises `ScaleError`: no usable reading, a reading of 0, a spot outside the picture, or one that is clipped, dark or
    moved.
    """
    measured = _measured(readings, frames, meter)
    spot = Spot(*sighted(image.geometry, longitude_rad, latitude_rad), meter.spot_rad)
    found = spot_pixels(image.geometry, spot)
    warnings = _check_spot(image, found)
    values = luminance_cd_m2(image.rgb[found.row, found.column]).astype(np.float64)
    displayed = float(values @ found.share)
    if not displayed > 0 or not math.isfinite(displayed):
        raise ScaleError("the target is black in the picture", where="the meter's spot", advice=_OTHER_TARGET)
    # The uncertainty of the spot's mean: noise, which averages out, and the curve's error, which does not
    claimed = np.asarray(image.uncertainty[found.row, found.column], dtype=np.float64)
    claimed2 = float(np.where(np.isfinite(claimed), claimed, 1.0) ** 2 @ found.share)
    scatter2 = float(((values / displayed - 1) ** 2) @ found.share)
    independent = max(found.n_effective / NEIGHBOURS, 1.0)
    parts = {
        "meter": measured.meter_frac,
        "spot": _pointing_part(image, spot, displayed, meter.pointing_rad),
        "picture": math.sqrt(max(claimed2, scatter2) / independent + CURVE_FRAC**2),
        "drift": max(measured.drift_part, repeat_frac / math.sqrt(12)),
    }
    if parts["spot"] > SPOT_WARNING_FRAC:
        what = "an edge or a patch of sun on the target"
        warnings.append(f"the light changes by {parts['spot']:.1%} within the aiming error: {what}")
    if measured.drift_frac is not None and abs(measured.drift_frac) > DRIFT_WARNING_FRAC:
        warnings.append(f"the light changed by {measured.drift_frac:+.1%} from the first reading to the last")
    return ScaleFactor(
        value=measured.luminance_cd_m2 / displayed,
        relative_uncertainty=math.sqrt(math.fsum(u * u for u in parts.values())),
        parts=parts,
        n_pixels=found.n_effective,
        displayed=displayed,
        measured=measured.luminance_cd_m2,
        drift_frac=measured.drift_frac,
        warnings=tuple(warnings),
    )


def sighted(geometry: Geometry, longitude_rad: float, latitude_rad: float) -> tuple[float, float]:
    """Return a direction right of and above straight ahead as longitude and latitude (rad) in an indoor picture's axes.

    A fisheye at the eye has the line of sight as its zenith, and the room's up as its +y.
    """
    if not isinstance(geometry, Fisheye):
        return longitude_rad, latitude_rad
    right, ahead = (math.cos(latitude_rad) * part(longitude_rad) for part in (math.sin, math.cos))
    return math.atan2(-right, math.sin(latitude_rad)), math.asin(ahead)


def scaled(image: RelativeImage, scale: ScaleFactor, **attributes: object) -> LuminanceImage:
    """Return the picture times the factor: a picture in cd/m2. What it was scaled on is known: modes are 0 there.

    Each pixel's uncertainty has the modes of its level as they are from there on, instead of as the merge left them.
    """
    octaves, anchor = math.log2(scale.value), math.log2(scale.measured) if scale.measured else None
    rgb, uncertainty, own = np.asarray(image.rgb * np.float32(scale.value)), image.uncertainty, modes_of(image)
    modes = [mode.moved(octaves, anchor) for mode in own]
    before, after = ([mode for mode in some if mode.kind == "level"] for some in (own, modes))
    if anchor is not None and before:
        uncertainty = np.empty_like(uncertainty)
        for rows in bands(len(rgb), ROWS_AT_ONCE):
            was, now = (together(m, luminance_cd_m2(y[rows])) for m, y in ((before, image.rgb), (after, rgb)))
            with np.errstate(over="ignore"):
                squares = np.square(image.uncertainty[rows]) - np.square(was) + np.square(now)
            np.sqrt(np.maximum(squares, LEAST_UNCERTAINTY**2), out=uncertainty[rows])
    return LuminanceImage(
        rgb=rgb,
        uncertainty=uncertainty,
        validity=image.validity,
        geometry=image.geometry,
        scale_uncertainty=scale.relative_uncertainty,
        ghost=image.ghost,
        attributes=with_modes({**image.attributes, **attributes}, modes),
    )


def combined(first: ScaleFactor, second: ScaleFactor) -> ScaleFactor:
    """Return the product of two factors (k1 k2 of eq. 2), their uncertainties in quadrature."""
    return replace(
        first,
        value=first.value * second.value,
        relative_uncertainty=math.hypot(first.relative_uncertainty, second.relative_uncertainty),
        parts={"k1": first.relative_uncertainty, "k2": second.relative_uncertainty},
        warnings=(*first.warnings, *second.warnings),
    )


_OTHER_TARGET = "meter a target that is neither clipped nor dark, or give --k1"


def _measured(readings: Sequence[ReadingRecord], frames: Sequence[FrameRecord], meter: MeterAccuracy) -> _Measured:
    usable = [r for r in readings if r.status in _USABLE and r.luminance_cd_m2 is not None]
    if not usable:
        had = f"{len(readings)} with status {', '.join(sorted({r.status for r in readings}))}" if readings else "none"
        advice = "give --k1, or capture or import the room again, with --reading CD_M2"
        raise ScaleError(f"no usable meter reading ({had})", where="readings", advice=advice)
    values = np.array([float(r.luminance_cd_m2 or 0.0) for r in usable])
    if not np.all(values > 0):
        raise ScaleError("a meter reading of 0 gives no scale", where="readings", advice=_OTHER_TARGET)
    fraction = max(_meter_part(r, meter) for r in usable)
    if len(usable) == 1:
        return _Measured(float(values[0]), fraction, None, 0.0)
    times, moment = _times(usable, frames)
    order = np.argsort(times, kind="stable")
    times, values = times[order], values[order]
    drift = float(values[-1] / values[0] - 1)
    # Between the readings the light may have gone any way: a rectangle of the drift's width, half where interpolated.
    # A moment outside them is another clock's, or they were typed later: no weight is known.
    if moment is None or not times[0] < moment < times[-1]:
        return _Measured(float(values.mean()), fraction, drift, abs(drift) / math.sqrt(12))
    return _Measured(float(np.interp(moment, times, values)), fraction, drift, abs(drift) / math.sqrt(12) / 2)


def _times(readings: Sequence[ReadingRecord], frames: Sequence[FrameRecord]) -> tuple[Doubles, float | None]:
    """Return the readings' times and the frames' mean moment, by one clock; None where frames have no times."""
    monotonic = [r.taken_monotonic_s for r in readings]
    opened = [f.release_monotonic_s + f.camera_s / 2 for f in frames if f.release_monotonic_s is not None]
    if None not in monotonic and opened and _one_boot(readings, frames):
        return np.array(monotonic, dtype=np.float64), float(np.mean(opened))
    begin = readings[0].taken_utc
    seen = [(f.taken_utc - begin).total_seconds() + f.camera_s / 2 for f in frames if f.taken_utc is not None]
    times = np.array([(r.taken_utc - begin).total_seconds() for r in readings])
    return times, float(np.mean(seen)) if seen else None


def _one_boot(readings: Sequence[ReadingRecord], frames: Sequence[FrameRecord]) -> bool:
    """Whether monotonic times run with UTC in all records: those of another start of the computer begin anew."""
    read = ((r.taken_utc, r.taken_monotonic_s) for r in readings)
    seen = ((f.taken_utc, f.release_monotonic_s) for f in frames)
    starts_s = [utc.timestamp() - at_s for utc, at_s in (*read, *seen) if utc is not None and at_s is not None]
    return max(starts_s) - min(starts_s) <= ONE_BOOT_S


def _meter_part(reading: ReadingRecord, meter: MeterAccuracy) -> float:
    """Return the meter's relative standard uncertainty: accuracy, last digit, scatter of its samples."""
    value = float(reading.luminance_cd_m2 or 0.0)
    last = re.findall(r"[0-9]+(?:\.([0-9]+))?", reading.raw)
    step = 10.0 ** -len(last[-1]) if last else 10.0 ** (math.floor(math.log10(value)) - 3)
    halfwidth = math.hypot(meter.relative, meter.digits * step / value)
    # (max - min) of a few samples is about twice their standard deviation.
    scatter = reading.spread_frac / 2 / math.sqrt(reading.n_samples)
    return math.hypot(halfwidth / math.sqrt(3), scatter, meter.spectral)


def _check_spot(image: RelativeImage, found: SpotPixels) -> list[str]:
    """Return warnings; refuse a spot whose values are not the target's."""
    share = shares(image, found)
    reasons = {
        Validity.CLIPPED: "brighter than every frame can record (clipped)",
        Validity.DARK: "darker than every frame can record",
        Validity.OUTSIDE: "outside the lens's field of view",
        Validity.REPAIRED: "a repaired value, not a measured one",
    }
    for kind, reason in reasons.items():
        if share[kind] > 0:
            raise ScaleError(f"{share[kind]:.0%} of it is {reason}", where="the meter's spot", advice=_OTHER_TARGET)
    moving = 0.0 if image.ghost is None else float(found.share[image.ghost[found.row, found.column] > 0].sum())
    if moving > MAX_GHOST_SHARE:
        text = f"something moved over {moving:.0%} of the meter's spot (ghost)"
        likely = "a person or a shadow in front of the target"
        raise ScaleError(text, where="the meter's spot", likely=likely, advice="capture again, or give another target")
    return [f"something moved over {moving:.0%} of the meter's spot"] if moving > 0 else []


def _pointing_part(image: RelativeImage, spot: Spot, displayed: float, pointing_rad: float) -> float:
    """Return how much the spot's mean varies within the uncertainty of its aim (per axis), relative."""
    changes = []
    for other in moved(spot, pointing_rad):
        try:
            changes.append(spot_luminance(image, other) / displayed - 1)
        except ScaleError:
            continue  # at the picture's edge: the other directions decide
    # Over all ways the mean square of a gradient's change is half of its square.
    return math.sqrt(2 * float(np.mean(np.square(changes)))) if changes else 0.0


_SAMPLES = 16_384  # spread evenly over the spot: an edge across it is then right to 0.1 % of its contrast


def spot_pixels(geometry: Geometry, spot: Spot) -> SpotPixels:
    """Return the pixels of a spot.

    Raises `ScaleError`: part of the spot lies outside the picture.
    """
    x, y, seen = pixels(geometry, _spread(spot.direction(), spot.diameter_rad / 2))
    if not np.all(seen):
        longitude, latitude = math.degrees(spot.longitude_rad), math.degrees(spot.latitude_rad)
        text = f"the meter's spot at longitude {longitude:.2f}, latitude {latitude:.2f} degrees is outside the picture"
        advice = "give the target's direction: longitude right of the picture's centre, latitude up"
        raise ScaleError(text, likely="a target meant for another camera", advice=advice)
    column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    wide, high = geometry.width_px, geometry.height_px
    column = column % wide if isinstance(geometry, Equirectangular) else np.clip(column, 0, wide - 1)
    place, count = np.unique(np.clip(row, 0, high - 1) * wide + column, return_counts=True)
    return SpotPixels(place // wide, place % wide, count / count.sum())


def spot_luminance(image: RelativeImage, spot: Spot) -> float:
    """Return the mean luminance of a spot in the picture's own scale."""
    found = spot_pixels(image.geometry, spot)
    return float(luminance_cd_m2(image.rgb[found.row, found.column]) @ found.share)


def shares(image: RelativeImage, found: SpotPixels) -> dict[Validity, float]:
    """Return what share of a spot has each validity."""
    validity = image.validity[found.row, found.column]
    return {kind: float(found.share[validity == kind].sum()) for kind in Validity}


def moved(spot: Spot, angle_rad: float, count: int = 8) -> list[Spot]:
    """Return ``count`` spots around one, ``angle_rad`` away in evenly spaced ways."""
    out = []
    centre, side, up = _frame(spot.direction())
    for turn in np.arange(count) * (2 * math.pi / count):
        way = math.cos(angle_rad) * centre + math.sin(angle_rad) * (math.cos(turn) * side + math.sin(turn) * up)
        out.append(Spot(math.atan2(way[0], way[1]), math.asin(float(np.clip(way[2], -1, 1))), spot.diameter_rad))
    return out


def _frame(centre: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return three vectors at right angles, the first the one given."""
    pole = np.array((0.0, 0.0, 1.0)) if abs(centre[2]) < 0.9 else np.array((0.0, 1.0, 0.0))
    side = np.cross(centre, pole)
    side /= np.linalg.norm(side)
    return centre, side, np.cross(side, centre)


def _spread(centre: Doubles, radius_rad: float) -> Doubles:
    """Return directions (n, 3), each for the same solid angle of a disc (a sunflower: golden-angle spiral)."""
    middle, side, up = _frame(centre)
    # Equal steps of 1 - cos(angle) are equal solid angles.
    drop = (1 - math.cos(radius_rad)) * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    off = np.sqrt(drop * (2 - drop))[:, None]
    turn = (np.arange(_SAMPLES) * (math.pi * (3 - math.sqrt(5))))[:, None]
    return np.asarray((1 - drop)[:, None] * middle + off * (np.cos(turn) * side + np.sin(turn) * up))


def given_scale(name: str, value: float) -> ScaleFactor:
    """Return a factor that the user gave, with the warning that nothing is known of its uncertainty."""
    warning = f"{name} was given: its uncertainty is unknown and not included in the stated uncertainties"
    return ScaleFactor(value, 0.0, {"given": 0.0}, warnings=(warning,))


@dataclass(frozen=True)
class Calibrated:
    """One side's picture, its scale, and what there is to say of it (plain JSON values)."""

    image: LuminanceImage
    scale: ScaleFactor
    facts: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def of_camera(self) -> ScaleFactor:
        """The scale with what the lens may have done to the light of its spot: another camera's does not share that."""
        modes = modes_of(self.image)
        lens = [mode.places[2] for mode in modes if mode.kind == "scatter"]
        lens += [mode.values[0] for mode in modes if mode.name == "fall-off"]  # ahead, where nothing falls off
        return replace(self.scale, relative_uncertainty=math.hypot(self.scale.relative_uncertainty, *lens))
