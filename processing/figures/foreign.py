"""Pictures and calibration files of other programs: hdrgen's response, Radiance's .cal files, brackets without a room.

hdrgen writes a camera's response as a polynomial a channel: exposure over that of code 255, by the code over 255; times
87 N2 / (t ISO) it is cd/m2. LumiLab's .cal files hold a fall-off (`sf=1/(a r^8 + ... + 1)`) or factors a channel.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from processing.calibration.merge.merge import MergeOptions, merge
from processing.calibration.outdoor.lens import find_image_circle
from processing.calibration.response.curve import ResponseCurve
from processing.calibration.response.response import estimate_noise, recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.response.shutter import camera_rule, true_time_s
from processing.calibration.scale.photometry import luminance_map
from processing.calibration.scale.vignetting import Vignetting
from processing.errors import ParameterError, PictureFileError
from processing.ground.arrays import Doubles
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.frames import Reduce, array_frame, frame_of
from processing.pictures.images import LuminanceImage, Validity
from processing.pictures.modes import camera_modes, modes_of, widened, with_modes
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions

HDRGEN_K = 87.0
"""cd/m2 of exposure 1 in a second at f/1 and ISO 1 (panlib, exif.cpp: 87 N2 / (t ISO))."""
HDRGEN_SIGMA = 0.05
"""Relative standard uncertainty of a scale by exposure settings: apertures and speeds are as engraved; chosen."""
ENOUGH_PX = 900  # across: as evalglare's usual pictures; frames are reduced to no less
FALLOFF_SIGMA = 0.01  # of a published fall-off at the rim, for another copy of the lens; chosen
_TERM = re.compile(r"\(\(([-+.\deE]+)\)\*\(?r\^?(\d*)\)?\)|\(\(([-+.\deE]+)\)\*r\)")
_GAIN = re.compile(r"\b([rgb])o\s*=\s*(?:([\d.]+)\s*\*\s*)?[rgb]i\(1\)(?:\s*\*\s*([\d.]+))?\s*;")
_TIED = slice(30, 221)  # codes over which our curve and hdrgen's have the same mean; chosen: clear of both ends


@dataclass(frozen=True)
class CalFile:
    """What a .cal file does."""

    falloff: Vignetting | None
    gains: tuple[float, float, float]


def read_cal(path: Path) -> CalFile:
    """Read a fall-off or factors; raises `PictureFileError` for a file that holds neither."""
    text = _text(path)
    if "sf=" in text.replace(" ", ""):
        pairs = [(a or c, b or "1") for a, b, c in _TERM.findall(text)]
        known = {int(power): float(value) for value, power in pairs if abs(float(value)) > 1e-9}
        if known:
            # Centred on 500 they are for pictures turned into equidistant ones before; else for those as taken.
            turned = "500" in text
            falloff = Vignetting(tuple(known), tuple(known.values()), FALLOFF_SIGMA, in_angle=turned, source=path.name)
            return CalFile(falloff, (1.0, 1.0, 1.0))
    found = {channel: float(before or after or 1) for channel, before, after in _GAIN.findall(text)}
    if set(found) != set("rgb"):
        raise PictureFileError("holds neither a fall-off nor factors a channel", where=path.name)
    return CalFile(None, (found["r"], found["g"], found["b"]))


def read_rsp(path: Path) -> Doubles:
    """Return log2 exposure, of shape (3, 256), of hdrgen's response polynomials; 0 at code 255."""
    try:
        rows = [[float(v) for v in line.split()[1:]] for line in _text(path).splitlines() if line.strip()]
        found = np.log2(np.maximum([np.polyval(row, np.arange(256) / 255) for row in rows], 1e-6))
    except ValueError:
        found = np.zeros((0, 256))
    if found.shape != (3, 256) or not np.isfinite(found).all():
        raise PictureFileError("is no response of hdrgen", where=path.name, advice="three lines: order, coefficients")
    return np.asarray(found - found[:, 255:])


def _text(path: Path) -> str:
    try:
        return path.read_text("ascii", errors="replace")[:100_000]
    except OSError as error:
        raise PictureFileError(f"cannot be read ({error.strerror})", where=path.name) from error


def view_geometry(view: str, width: int, height: int) -> Fisheye | Equirectangular:
    """Return the geometry of "fisheye,MAPPING,DEGREES" (filling the picture's shorter side) or "panorama"."""
    kind, *rest = view.lower().split(",")
    if kind == "panorama" and not rest:
        return Equirectangular(width, height)
    try:
        mapping, degrees = LensMapping(rest[0]), float(rest[1])
    except (ValueError, IndexError):
        names = ", ".join(m.value for m in LensMapping)
        raise ParameterError(f"--view {view!r}", advice=f"panorama, or fisheye,MAPPING,DEGREES ({names})") from None
    return Fisheye(width, height, mapping, min(width, height) / 2, math.radians(degrees) / 2)


def applied(image: LuminanceImage, files: Sequence[CalFile]) -> LuminanceImage:
    """Return the picture after the .cal files: fall-off taken off, channels multiplied; their doubt is shared."""
    for one in files:
        rgb = image.rgb * np.array(one.gains, np.float32)
        modes = []
        if one.falloff is not None:
            if not isinstance(image.geometry, Fisheye):
                raise ParameterError("a lens's fall-off needs a fisheye picture", advice="give --view")
            rgb = one.falloff.correct(rgb, image.geometry)
            modes = camera_modes(1.0, two_lenses=False, falloff_sigma=one.falloff.relative_uncertainty)[1:]
        octaves = math.log2(float(np.dot(one.gains, LUMINANCE_WEIGHTS)))
        moved = with_modes(image.attributes, [mode.moved(octaves) for mode in modes_of(image)])
        image = widened(replace(image, rgb=np.asarray(rgb, np.float32), attributes=moved), modes)
    return image


@dataclass(frozen=True)
class Taken:
    """One frame of a bracket."""

    path: Path
    time_s: float
    f_number: float
    iso: float
    model: str


def merged_bracket(frames: Sequence[Taken], response: Doubles | None, mapping: str, field_deg: float) -> LuminanceImage:
    """Return a bracket of a fisheye merged, in cd/m2 by the frames' settings (hdrgen's constant), in its image circle.

    ``response``: log2 exposure of shape (3, 256) of a published curve, in whose gauge ours is put; None: our own.
    """
    sources = [frame_of(one.path) for one in frames]
    reduce: Reduce = next((f for f in (8, 4, 2) if min(sources[0].size_px) // f >= ENOUGH_PX), 1)
    codes = [np.asarray(source.decode(reduce), dtype=np.uint8) for source in sources]
    rule = camera_rule(frames[0].model)
    times = [true_time_s(one.time_s, rule) if rule else one.time_s for one in frames]
    bracket = Bracket8(codes, times, [one.time_s for one in frames])
    fit = recover_response([bracket], estimate_times=rule is None)
    curve, noise = fit.curve, fit.noise
    if response is not None:
        curve = _in_gauge(curve, response)
        noise = estimate_noise([bracket], curve)
    circle = find_image_circle(codes)
    half = math.radians(field_deg) / 2
    height_px, width_px = codes[0].shape[:2]
    lens = Fisheye(width_px, height_px, LensMapping(mapping), circle.radius_px, half, circle.centre_px)
    image = merge(
        [array_frame(one, taken.path.name) for one, taken in zip(codes, frames, strict=True)],
        fit.times_s,
        curve,
        noise,
        geometry=lens,
        options=MergeOptions(ghosts=False, own_curve=True),
        time_sigma=fit.time_sigma,
        given_s=bracket.given_s,
    ).image
    factor = HDRGEN_K * frames[0].f_number ** 2 / frames[0].iso
    modes = [mode.moved(math.log2(factor)) for mode in modes_of(image)]
    _, seen = directions(lens)
    validity = np.where(seen, image.validity, np.uint8(Validity.OUTSIDE))
    light = np.where(seen[..., None], image.rgb * np.float32(factor), 0).astype(np.float32)
    said = with_modes({"scale": "exposure settings, hdrgen's constant"}, modes)
    picture = LuminanceImage(light, image.uncertainty, validity, lens, HDRGEN_SIGMA, attributes=said)
    mean = float(np.mean(luminance_map(picture)))
    return widened(picture, camera_modes(mean, two_lenses=False))


def _in_gauge(curve: ResponseCurve, response: Doubles) -> ResponseCurve:
    """Return our curve with the mean log exposure of another over codes 30 to 220, by channel."""
    off = (response - curve.log2_exposure)[:, _TIED].mean(axis=1, keepdims=True)
    return replace(curve, log2_exposure=curve.log2_exposure + off)
