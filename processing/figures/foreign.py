"""Pictures and calibration files of other programs: hdrgen's response, factors of .cal files, brackets without a room.

hdrgen writes a camera's response as a polynomial a channel: exposure over that of code 255, by the code over 255; times
87 N2 / (t ISO) it is cd/m2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from processing.calibration.merge.merge import MergeOptions, merge
from processing.calibration.merge.motion import check_view
from processing.calibration.optics import glare_taken_off
from processing.calibration.outdoor.lens import find_image_circle
from processing.calibration.response.response import WHITE_CODE, estimate_noise, recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.response.shutter import camera_rule, true_time_s
from processing.calibration.scale.photometry import PLANES, illuminances_lx, luminance_map
from processing.calibration.scale.veiling_glare import kernel_modes, unmeasured_modes
from processing.calibration.scale.vignetting import COPY_SIGMA
from processing.errors import BracketError, LensError, ParameterError, PictureFileError, ScaleError
from processing.figures.cal import CalFile, text_of
from processing.figures.uncertainty import QUANTILES, Figure, light_figure, statistics
from processing.ground.arrays import Doubles
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.exr import read_any_exr
from processing.pictures.frames import Reduce, array_frame, frame_of
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.pictures.modes import falloff_mode, modes_of, multiplied, widened, with_modes
from processing.pictures.radiance import RELATIVE_MARK, WHITE_EFFICACY_LM_W, read_radiance_hdr
from processing.pictures.writing import check_light
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions, solid_angles

HDRGEN = (87.0, 0.05, "exposure settings, hdrgen's constant")
"""cd/m2 of exposure 1 in a second at f/1 and ISO 1 (panlib, exif.cpp: 87 N2 / (t ISO)), its relative standard
uncertainty (apertures and speeds are as engraved; chosen), and what it is."""
SATURATION = (78 / 0.65, 0.13, "exposure settings, ISO 12232's saturation")
"""The same: 78 lx s over the speed saturate, with 0.65 L t / N2 on the sensor (ISO 12232); makers' speeds are within a
third of a stop, taken as even (GUM 4.3.7)."""
ENOUGH_PX = 900  # across: as evalglare's usual pictures; frames are reduced to no less
_TIED = slice(30, 221)  # codes over which our curve and hdrgen's have the same mean; chosen: clear of both ends


def read_rsp(path: Path) -> Doubles:
    """Return log2 exposure, of shape (3, 256), of hdrgen's response polynomials; 0 at code 255."""
    try:
        rows = [[float(v) for v in line.split()] for line in text_of(path).splitlines() if line.strip()]
        whole = all(len(row) == row[0] + 2 for row in rows)
        found = np.log2(np.maximum([np.polyval(row[1:], np.arange(256) / 255) for row in rows], 1e-6))
    except ValueError:
        found, whole = np.zeros((0, 256)), False
    rises = whole and found.shape == (3, 256) and (found[:, 255] > found[:, _TIED.start]).all()
    if not (rises and np.isfinite(found).all()):
        raise PictureFileError("is not hdrgen's response", where=path.name, advice="three lines: order, coefficients")
    return np.asarray(found - found[:, 255:])


def view_geometry(view: str, width: int, height: int) -> Fisheye | Equirectangular:
    """Return the geometry of "fisheye,MAPPING,DEGREES" (filling the picture's shorter side) or "panorama"."""
    if view.lower() == "panorama":
        return Equirectangular(width, height)
    try:
        kind, name, angle = view.lower().split(",")
        mapping, degrees = {"fisheye": LensMapping}[kind](name), float(angle)
        return Fisheye(width, height, mapping, min(width, height) / 2, math.radians(degrees) / 2)
    except (ValueError, KeyError, LensError, ParameterError):
        names = ", ".join(m.value for m in LensMapping if m is not LensMapping.POLYNOMIAL)
        advice = f"panorama, or fisheye,MAPPING,DEGREES ({names}; up to 360 degrees, orthographic 180)"
        raise ParameterError(f"--view {view!r}", advice=advice) from None


def applied(image: LuminanceImage, files: Sequence[CalFile]) -> LuminanceImage:
    """Return the picture after the .cal files: fall-off taken off, channels multiplied; their doubt is shared."""
    for one in files:
        check_light(image.rgb, "--cal", max(one.gains))
        lens = image.geometry if isinstance(image.geometry, Fisheye) else None
        if one.varies and lens is None:
            raise ParameterError("a lens's vignetting needs a fisheye picture", advice="give --view")
        factors = np.array(one.gains, np.float32) if lens is None else one.factors(lens)
        rgb, modes = image.rgb * factors, [falloff_mode(COPY_SIGMA)] if one.varies else []
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
    turns: int = 0
    """Quarters, counter-clockwise, by which EXIF wants it shown."""


def merged_bracket(frames: Sequence[Taken], response: Doubles | None, mapping: str, field_deg: float) -> LuminanceImage:
    """Return a bracket of a fisheye merged, in cd/m2 by the frames' settings, in its image circle.

    ``response``: log2 exposure of shape (3, 256) of a published curve, in whose gauge ours is put, with hdrgen's
    constant that belongs to it; None: our own curve, whose white is where a camera of that speed saturates.
    """
    sources = [frame_of(one.path, coded=True) for one in frames]
    reduce: Reduce = next((f for f in (8, 4, 2) if min(sources[0].size_px) // f >= ENOUGH_PX), 1)
    # All as the first one: pointed upwards, a camera does not know how it is held
    turned = (np.rot90(source.decode(reduce), frames[0].turns) for source in sources)
    codes = [np.ascontiguousarray(one, dtype=np.uint8) for one in turned]
    falling = sorted(range(len(frames)), key=lambda k: -frames[k].time_s)
    check_view([sources[k] for k in falling], [codes[k] for k in falling])
    rule = camera_rule(frames[0].model)
    times = [true_time_s(one.time_s, rule) if rule else one.time_s for one in frames]
    bracket = Bracket8(codes, times, [one.time_s for one in frames], [one.path.name for one in frames])
    fit = recover_response([bracket], estimate_times=rule is None)
    curve, noise = fit.curve, fit.noise
    if response is None and curve.gauge_code != WHITE_CODE:
        raise ScaleError("no frame comes near white, where speed is defined", advice="give --response")
    if response is not None:
        off = (response - curve.log2_exposure)[:, _TIED].mean(axis=1, keepdims=True)
        curve = replace(curve, log2_exposure=curve.log2_exposure + off)
        noise = estimate_noise([bracket], curve)
    constant, sigma, said = SATURATION if response is None else HDRGEN
    circle = find_image_circle(codes)
    half = math.radians(field_deg) / 2
    height_px, width_px = codes[0].shape[:2]
    lens = Fisheye(width_px, height_px, LensMapping(mapping), circle.radius_px, half, circle.centre_px)
    arrays = [array_frame(one, taken.path.name) for one, taken in zip(codes, frames, strict=True)]
    how, off, given_s = MergeOptions(ghosts=False, own_curve=True), fit.time_sigma, bracket.given_s
    image = merge(arrays, fit.times_s, curve, noise, geometry=lens, options=how, time_sigma=off, given_s=given_s).image
    factor = constant * frames[0].f_number ** 2 / frames[0].iso
    modes = [mode.moved(math.log2(factor)) for mode in modes_of(image)]
    image, kernel, _ = glare_taken_off(image, lens)
    _, seen = directions(lens)
    validity = np.where(seen, image.validity, np.uint8(Validity.OUTSIDE))
    light = np.where(seen[..., None], image.rgb * np.float32(factor), 0).astype(np.float32)
    picture = LuminanceImage(light, image.uncertainty, validity, lens, sigma, None, with_modes({"scale": said}, modes))
    return widened(picture, unmeasured_modes(picture) if kernel is None else kernel_modes(picture, kernel))


# Opening, scaling and summing up pictures for ``daylit figures``.

UNKNOWN_SIGMA = 0.1
"""Relative standard uncertainty of a scale that a file of another program implies; chosen: exposure settings' own."""
_SPOT_PX = 2  # around a reading's pixel; chosen
_EXIF, _TIME, _APERTURE, _SPEED, _MODEL, _ORIENTATION = 0x8769, 0x829A, 0x829D, 0x8827, 0x0110, 0x0112  # EXIF 2.32
_MORE = 65535  # as speed: more than the field holds, and not known
_TURNS = {3: 2, 6: 3, 8: 1}  # by orientation
_FRAMES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")


def picture_of(path: Path, view: str | None, *, stated: bool = True) -> LuminanceImage:
    """Return an EXR or Radiance HDR picture; ``view`` overrides what the file says it shows.

    Without ``stated`` values are as they are in the file, whatever it or Radiance's convention says of their unit.
    """
    head = path.read_bytes()[:4]
    if head.startswith(b"#?"):
        picture = read_radiance_hdr(path)
        if view is None and picture.view and picture.geometry is None:
            raise ParameterError(f"{path.name} states another view: {picture.view[:80]}", advice="give --view")
        rgb = picture.rgb if stated else picture.rgb / np.float32(WHITE_EFFICACY_LM_W)
        return _plain(rgb, picture.geometry, view, path, absolute=RELATIVE_MARK not in picture.header)
    if head != b"\x76\x2f\x31\x01":
        raise PictureFileError("is neither EXR nor Radiance HDR", where=path.name, advice="give an HDR picture")
    image = read_any_exr(path)
    if isinstance(image, tuple):
        rgb, white = image if stated else (image[0], None)
        return _plain(rgb * np.float32(white or 1.0), None, view, path, absolute=white is not None)
    if isinstance(image, RelativeImage):
        image = LuminanceImage(**vars(image), scale_uncertainty=0.0, absolute=False)
    height, width = image.validity.shape
    return image if view is None else replace(image, geometry=view_geometry(view, width, height))


def _plain(rgb: np.ndarray, known: object, view: str | None, path: Path, *, absolute: bool) -> LuminanceImage:
    height, width = rgb.shape[:2]
    if view is None and not isinstance(known, Fisheye | Equirectangular):
        if width != 2 * height:
            raise ParameterError(f"{path.name} does not state its projection", advice="give --view")
        known = Equirectangular(width, height)
    geometry = view_geometry(view, width, height) if view is not None else known
    assert isinstance(geometry, Fisheye | Equirectangular)
    _, seen = directions(geometry)
    validity = np.where(seen, Validity.VALID, Validity.OUTSIDE).astype(np.uint8)
    light = np.where(seen[..., None], rgb, 0).astype(np.float32)
    sigma = UNKNOWN_SIGMA if absolute else math.inf
    return LuminanceImage(light, np.zeros((height, width), np.float32), validity, geometry, sigma, absolute=absolute)


def rescaled(image: LuminanceImage, factor: float, sigma: float, where: str = "--scale") -> LuminanceImage:
    """Return the picture times a factor (of ``where``) of a relative standard uncertainty, inf: not known."""
    check_light(image.rgb, where, factor)
    return replace(multiplied(image, factor), scale_uncertainty=sigma, absolute=True)


def by_reading(image: LuminanceImage, level: float, place: tuple[float, float], sigma: float) -> LuminanceImage:
    """Return the picture scaled so that it has ``level`` cd/m2 around a column and row."""
    column, row = (int(v) for v in place)
    height, width = image.validity.shape
    if not (0 <= column < width and 0 <= row < height and level > 0):
        raise ParameterError("a reading is above 0 cd/m2, and lies in the picture")
    spot = (slice(max(row - _SPOT_PX, 0), row + _SPOT_PX + 1), slice(max(column - _SPOT_PX, 0), column + _SPOT_PX + 1))
    shown = float(luminance_map(image)[spot].mean(dtype=np.float64))
    if not shown > 0 or np.any(image.validity[spot] != Validity.VALID):
        raise ScaleError("the position is black, clipped or outside", advice="meter inside the picture")
    found = rescaled(image, level / shown, sigma, "--reading")
    modes = [mode.moved(0.0, math.log2(level)) for mode in modes_of(found)]
    return replace(found, attributes=with_modes(found.attributes, modes))


def light_figures(image: LuminanceImage) -> dict[str, Figure]:
    """Return illuminances (fisheye: across its axis; panorama: five planes) and luminances, if absolute named so."""
    fisheye = isinstance(image.geometry, Fisheye)
    planes = {"illuminance": (0.0, 0.0, 1.0)} if fisheye else {f"illuminance-{n}": p for n, p in PLANES.items()}
    lights = illuminances_lx(image, list(planes.values()))
    found = {name + "_lx" * image.absolute: light_figure(one) for name, one in zip(planes, lights, strict=True)}
    height, width = image.validity.shape
    return found | region_figures(image, [(0, 0, width, height)], ["picture"])


def region_figures(
    image: LuminanceImage, boxes: Sequence[tuple[int, int, int, int]], names: Sequence[str]
) -> dict[str, Figure]:
    """Return mean, quantiles and extremes of luminance by solid angle in boxes (left, top, right, bottom).

    Clipped and dark pixels count with their values, what lies outside the picture's field does not. Raises
    `ParameterError` for a box of which the picture shows nothing.
    """
    parts = []
    for (left, top, right, bottom), name in zip(boxes, names, strict=True):
        mask = np.zeros(image.validity.shape, bool)
        mask[max(top, 0) : max(bottom, 0), max(left, 0) : max(right, 0)] = True
        parts.append((name, "region", mask))
    found = {one["name"]: one for one in statistics(image, solid_angles(image.geometry), parts)}
    for name in names:
        if name not in found:
            raise ParameterError(f"{name} is empty", advice="give a part inside the picture")
    unit, kinds = "_cd_m2" if image.absolute else "", ("mean", *QUANTILES)
    return {f"{name}-{kind}{unit}": found[name][kind] for name in names for kind in kinds}


def taken_frames(folder: Path) -> list[Taken]:
    """Return a bracket's frames with what EXIF says of them; raises `BracketError` where it says too little."""
    from PIL import Image

    found = []
    for path in sorted(p for p in folder.glob("[!.]*") if p.suffix.lower() in _FRAMES):
        try:
            with Image.open(path) as picture:
                exif = picture.getexif()
                own = exif.get_ifd(_EXIF)
                said = [float(own[tag]) for tag in (_TIME, _APERTURE, _SPEED)]
        except (OSError, KeyError, ValueError, TypeError, ZeroDivisionError):
            said = [0.0] * 3
        if not (min(said) > 0 and all(map(math.isfinite, said)) and said[2] != _MORE):
            raise BracketError("has no time, aperture or speed in EXIF", where=path.name)
        time_s, aperture, speed = said
        model, turns = str(exif.get(_MODEL, "")).strip("\0 "), _TURNS.get(exif.get(_ORIENTATION, 1), 0)
        found.append(Taken(path, time_s, aperture, speed, model, turns))
    if len(found) < 2:
        raise BracketError("holds no bracket", where=folder.name, advice="give a folder with a camera's frames")
    for name in ("f_number", "iso", "model"):
        if len(different := {getattr(one, name) for one in found}) > 1:
            what = f"frames of different {name}: {', '.join(sorted(map(str, different)))}"
            raise BracketError(what, where=folder.name, advice="only the time may differ within a bracket")
    return found
