"""Opening, scaling and summing up pictures for ``daylit figures``."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from processing.calibration.scale.photometry import PLANES, illuminance_lx, luminance_map
from processing.errors import BracketError, ParameterError, PictureFileError, ScaleError
from processing.figures.foreign import Taken, view_geometry
from processing.figures.indices import with_uncertainty
from processing.pictures.exr import read_exr, read_exr_rgb
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.pictures.modes import modes_of, with_modes
from processing.pictures.radiance import read_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, directions

UNKNOWN_SIGMA = 0.1
"""Relative standard uncertainty of a scale that a file of another program implies; chosen: exposure settings' own."""
_SPOT_PX = 2  # around a reading's pixel; chosen
_EXIF, _TIME, _APERTURE, _SPEED, _MODEL = 0x8769, 0x829A, 0x829D, 0x8827, 0x0110  # tags of EXIF 2.32
_FRAMES = (".jpg", ".jpeg", ".png", ".tif", ".tiff")
Figure = dict[str, float]


def picture_of(path: Path, view: str | None) -> LuminanceImage:
    """Return an EXR or Radiance HDR picture; ``view`` overrides what the file says it shows."""
    head = path.read_bytes()[:4]
    if head.startswith(b"#?"):
        picture = read_radiance_hdr(path)
        return _plain(picture.rgb, picture.geometry, view, path)
    if head != b"\x76\x2f\x31\x01":
        raise PictureFileError("is neither EXR nor Radiance HDR", where=path.name, advice="give an HDR picture")
    try:
        image = read_exr(path)
    except PictureFileError as error:
        if "is not a picture of daylit" not in str(error):
            raise
        rgb, white = read_exr_rgb(path)
        return _plain(rgb * np.float32(white or 1.0), None, view, path)
    if isinstance(image, RelativeImage):
        image = LuminanceImage(
            image.rgb, image.uncertainty, image.validity, image.geometry, 0.0, None, image.attributes, absolute=False
        )
    height, width = image.validity.shape
    return image if view is None else replace(image, geometry=view_geometry(view, width, height))


def _plain(rgb: np.ndarray, known: object, view: str | None, path: Path) -> LuminanceImage:
    height, width = rgb.shape[:2]
    if view is None and not isinstance(known, Fisheye | Equirectangular):
        if width != 2 * height:
            raise ParameterError(f"{path.name} does not say what it shows", advice="give --view")
        known = Equirectangular(width, height)
    geometry = view_geometry(view, width, height) if view is not None else known
    assert isinstance(geometry, Fisheye | Equirectangular)
    _, seen = directions(geometry)
    validity = np.where(seen, Validity.VALID, Validity.OUTSIDE).astype(np.uint8)
    light = np.where(seen[..., None], rgb, 0).astype(np.float32)
    return LuminanceImage(light, np.zeros((height, width), np.float32), validity, geometry, UNKNOWN_SIGMA)


def rescaled(image: LuminanceImage, factor: float, sigma: float) -> LuminanceImage:
    """Return the picture times a factor of a relative standard uncertainty."""
    modes = [mode.moved(math.log2(factor)) for mode in modes_of(image)]
    rgb = np.asarray(image.rgb * np.float32(factor))
    return replace(
        image, rgb=rgb, scale_uncertainty=sigma, absolute=True, attributes=with_modes(image.attributes, modes)
    )


def by_reading(image: LuminanceImage, level: float, place: tuple[float, float], sigma: float) -> LuminanceImage:
    """Return the picture scaled so that it has ``level`` cd/m2 around a column and row."""
    column, row = (int(v) for v in place)
    height, width = image.validity.shape
    if not (0 <= column < width and 0 <= row < height and level > 0):
        raise ParameterError("a reading is above 0 cd/m2, and lies in the picture")
    spot = (slice(max(row - _SPOT_PX, 0), row + _SPOT_PX + 1), slice(max(column - _SPOT_PX, 0), column + _SPOT_PX + 1))
    shown = float(luminance_map(image)[spot].mean(dtype=np.float64))
    if not shown > 0 or np.any(image.validity[spot] != Validity.VALID):
        raise ScaleError(
            "the reading's place is black, clipped or outside", advice="read a place that the picture shows"
        )
    found = rescaled(image, level / shown, sigma)
    modes = [mode.moved(0.0, math.log2(level)) for mode in modes_of(found)]
    return replace(found, attributes=with_modes(found.attributes, modes))


def light_figures(image: LuminanceImage) -> dict[str, Figure]:
    """Return illuminances: of a fisheye on the plane across its axis, of a panorama on five planes; and luminances."""
    fisheye = isinstance(image.geometry, Fisheye)
    planes = {"illuminance": (0.0, 0.0, 1.0)} if fisheye else {f"illuminance-{n}": p for n, p in PLANES.items()}
    found = {}
    for name, plane in planes.items():
        light = illuminance_lx(image, plane)
        found[f"{name}_lx"] = {"value": light.value_lx, "uncertainty": light.uncertainty_lx}
    height, width = image.validity.shape
    return found | region_figures(image, (0, 0, width, height), "picture")


def region_figures(image: LuminanceImage, box: tuple[int, int, int, int], name: str) -> dict[str, Figure]:
    """Return mean, median, lowest and highest luminance of the valid pixels in a box (left, top, right, bottom)."""
    left, top, right, bottom = box
    part = (slice(top, bottom), slice(left, right))
    usable = image.validity[part] != Validity.OUTSIDE
    if not usable.any():
        raise ParameterError(f"{name} shows nothing", advice="give a part inside the picture")
    kinds = {"mean": np.mean, "median": np.median, "lowest": np.min, "highest": np.max}
    found = {}
    for kind, of in kinds.items():
        value, off = with_uncertainty(lambda one, of=of: float(of(luminance_map(one)[part][usable])), image)  # type: ignore[misc]
        found[f"{name}-{kind}_cd_m2"] = {"value": value, "uncertainty": off}
    return found


def taken_frames(folder: Path) -> list[Taken]:
    """Return a bracket's frames with what EXIF says of them; raises `BracketError` where it says too little."""
    from PIL import Image

    found = []
    for path in sorted(p for p in folder.iterdir() if p.suffix.lower() in _FRAMES):
        try:
            with Image.open(path) as picture:
                exif = picture.getexif()
                own = exif.get_ifd(_EXIF)
                said = [float(own[tag]) for tag in (_TIME, _APERTURE, _SPEED)]
        except (OSError, KeyError, ValueError, TypeError, ZeroDivisionError):
            said = [0.0] * 3
        if not (min(said) > 0 and all(map(math.isfinite, said))):
            raise BracketError("has no time, aperture or speed in EXIF", where=path.name)
        time_s, aperture, speed = said
        found.append(Taken(path, time_s, aperture, speed, str(exif.get(_MODEL, "")).strip("\0 ")))
    if len(found) < 2:
        raise BracketError("holds no bracket", where=folder.name, advice="give a folder with a camera's frames")
    return found


def write_falsecolour(path: Path, image: LuminanceImage) -> None:
    """Write log luminance in colours, from the 1st to the 99.9th percentile, with a scale at the right."""
    import cv2

    level = luminance_map(image)
    seen = (image.validity != Validity.OUTSIDE) & (level > 0)
    low, high = (math.log10(v) for v in np.percentile(level[seen], (1, 99.9)))
    share = np.clip((np.log10(np.maximum(level, 1e-9)) - low) / max(high - low, 1e-9), 0, 1)
    height = level.shape[0]
    bar = np.repeat(np.linspace(1, 0, height)[:, None], max(24, height // 12), axis=1)
    shown = cv2.applyColorMap((255 * np.hstack([np.where(seen, share, 0), bar])).astype(np.uint8), cv2.COLORMAP_TURBO)
    for k in range(6):
        text, row = f"{10 ** (high - k / 5 * (high - low)):.3g}", int(12 + k / 5 * (height - 20))
        cv2.putText(
            shown, text, (level.shape[1] + 2, row), cv2.FONT_HERSHEY_PLAIN, 0.8, (255, 255, 255), 1, cv2.LINE_AA
        )
    if not cv2.imwrite(str(path), shown):
        raise PictureFileError("cannot be written", where=path.name)
