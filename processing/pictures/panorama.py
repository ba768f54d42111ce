"""One panorama in a file of anyone's, as a picture whose scale nothing gave (or which the file itself gives).

A photograph of 8 or 16 bits is taken as sRGB: its codes go through the inverse of that curve (IEC 61966-2-1), and
`WHITE` is the photograph's white. What is clipped is a lower bound, and marked so. Of light as OpenEXR and Radiance
hold it, the scale is kept where the file says that it is cd/m2; else the median direction becomes `MIDDLE`.
"""

import io
import math
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from processing.errors import PanoramaError, PictureFileError
from processing.ground.arrays import Floats
from processing.ground.colour import linear_of_srgb, luminance_cd_m2, srgb_encoded
from processing.ground.seam import share_of_sphere
from processing.pictures.exr import read_exr, read_exr_rgb, read_header
from processing.pictures.frames import Codes, check_strips, checked_size, refuse_alpha
from processing.pictures.images import LuminanceImage, RelativeImage, Validity
from processing.pictures.photographs import KINDS, pillow_formats, read_codes
from processing.pictures.radiance import WHITE_EFFICACY_LM_W, read_radiance_hdr
from processing.pictures.writing import check_light
from processing.sphere import Equirectangular

# What a photograph's own tags say of a panorama: projection and crop (GPano), orientation (EXIF), colours (ICC).


MAX_XMP_BYTES, MAX_PROFILE_BYTES = 1 << 20, 4 << 20  # chosen
SAME_CODES = 2  # chosen: by which profiles of one space differ after rounding
_ORIENTATION = 274  # EXIF tag
_TAG = re.compile(rb"(?<!/)GPano:(\w{1,64})(?:\s*=\s*[\"']|\s*>)\s*([^\"'<]{1,64})")
_SIZES = ("FullPano{}Pixels", "CroppedAreaImage{}Pixels")
Format = Literal["jpeg", "png", "tiff", "webp", "avif", "heic", "exr", "hdr"]
FORMATS: dict[str, Format] = {**KINDS, ".exr": "exr", ".hdr": "hdr"}
ADOBE = "it is in Adobe RGB by its EXIF, without a profile: taken as sRGB, so colours are off"
WHITE = 100.0  # relative units of a photograph's white
MIDDLE = 20.0  # relative units of the median direction of light without a scale: what is middle grey where white is 100
TONE_CURVE_UNCERTAINTY = 0.2
"""Relative, of a photograph's pixel: cameras do not keep to the sRGB curve, and do not say what they do instead. This
is a judgement, not a measurement."""
LIGHT_UNCERTAINTY = 0.05  # relative, of a pixel of light that comes without any uncertainty
CLIPPED_SHARE_OF_RANGE, DARK_SHARE_OF_RANGE = 250 / 255, 2 / 255  # of the largest code; chosen
ASPECT_TOLERANCE = 0.01  # of 2 : 1; chosen
LEAST_WIDTH_PX = 128  # chosen
CIRCLES_BLACK = 0.02  # of the mean; chosen


@dataclass(frozen=True)
class PhotoTags:
    """What was found; empty where nothing is said."""

    gpano: dict[str, str]
    """Properties of the namespace GPano of the XMP packet."""
    orientation: int
    profile: bytes
    """ICC."""
    adobe: bool = False
    """Its EXIF says Adobe RGB (DCF's mark R03), as cameras do that embed no profile."""


def read_tags(path: Path) -> PhotoTags:
    """Return the tags of a photograph; what cannot be read counts as not said (the pixels are checked elsewhere)."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path, formats=pillow_formats()) as image:
                profile = image.info.get("icc_profile") or b""
                packet = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
                orientation = image.getexif().get(_ORIENTATION, 1)
                adobe = b"R03\0" in (image.info.get("exif") or b"")
    except Exception:  # noqa: BLE001 (Pillow raises nearly anything over damaged files)
        return PhotoTags({}, 1, b"")
    profile = profile if len(profile) <= MAX_PROFILE_BYTES else b""
    return PhotoTags(_gpano(packet), orientation if isinstance(orientation, int) else 1, profile, adobe)


def _gpano(packet: str | bytes) -> dict[str, str]:
    raw = packet.encode("utf-8", "replace") if isinstance(packet, str) else bytes(packet)
    return {key.decode(): value.decode("utf-8", "replace") for key, value in _TAG.findall(raw[:MAX_XMP_BYTES])}


def check_tags(path: Path, tags: PhotoTags) -> PhotoTags:
    """Return the tags; `PanoramaError` where they say that the file is no whole, upright equirectangular panorama."""
    kind = tags.gpano.get("ProjectionType", "equirectangular")
    if kind.lower() != "equirectangular":
        raise PanoramaError(f"its tags say projection {kind!r}", where=path.name, advice="export it equirectangular")
    for side in ("Width", "Height"):
        whole, part = (tags.gpano.get(name.format(side), "").strip() for name in _SIZES)
        if whole.isdecimal() and part.isdecimal() and 0 < int(part) < int(whole):
            text = f"its tags say that it is cropped: {part} of {whole} pixels of {side.lower()}"
            raise PanoramaError(text, where=path.name, advice="export the whole sphere")
    if tags.orientation not in (0, 1):
        text = f"its tags say that it must be rotated (orientation {tags.orientation})"
        raise PanoramaError(text, where=path.name, advice="save it upright")
    return tags


def to_srgb(codes: Codes, tags: PhotoTags) -> tuple[Codes, tuple[str, ...]]:
    """Return the codes in sRGB, and what there is to say: another profile is converted (16 bits by curve and matrix).

    ``codes``: (H, W, 3), uint8 or uint16.
    """
    if not tags.profile:
        return codes, (ADOBE,) * tags.adobe
    from PIL import Image, ImageCms

    levels, srgb = np.arange(256, dtype=np.uint8), ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB"))
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(tags.profile))
        name = ImageCms.getProfileDescription(profile).strip()[:80]
        turn = ImageCms.buildTransform(profile, srgb, "RGB", "RGB")
    except (ImageCms.PyCMSError, OSError, ValueError):
        return codes, ("its colour profile cannot be read as one of RGB: assumed to be sRGB",)

    def turned(colours: Codes) -> Codes:
        return np.asarray(ImageCms.applyTransform(Image.fromarray(colours), turn), np.uint8)

    # By what it does, for names mislead: there are sRGB's primaries with a straight line for a curve
    probe = np.stack(np.meshgrid(*[levels[::51]] * 3), axis=-1).reshape(-1, 6, 3)
    if np.abs(turned(probe).astype(int) - probe).max() <= SAME_CODES:
        return codes, ()
    if codes.dtype == np.uint8:
        return turned(codes), (f"converted from {name!r} to sRGB",)
    sides = [[getattr(one.profile, f"{of}_colorant") for of in ("red", "green", "blue")] for one in (profile, srgb)]
    if None in sides[0]:
        return codes, (f"its colour profile is {name!r}: assumed to be sRGB, so colours are off",)
    own, ours = (np.array([xyz for xyz, _ in one]).T for one in sides)
    grey = linear_of_srgb(turned(np.repeat(levels[:, None, None], 3, axis=2)))[:, 0, 1]
    light = np.interp(np.arange(1 << 16) / 257, levels, grey).astype(np.float32)[codes]
    light = np.clip(light @ np.linalg.solve(ours, own).T.astype(np.float32), 0, 1)
    return np.rint(65535 * srgb_encoded(light)).astype(np.uint16), (f"converted from {name!r} to sRGB",)


@dataclass(frozen=True)
class GivenPanorama:
    """A panorama, and what is to be said of it."""

    image: LuminanceImage
    source: str
    """Where the values are from, in words."""
    factor: float
    """What the file's own linear values (1: a photograph's white) were multiplied by."""
    clipped_share: float
    """Of all directions: brighter than the file can record."""
    notes: tuple[str, ...] = ()


def panorama_format(path: Path) -> Format:
    """Return the format by the file's ending; `PanoramaError` lists what is taken."""
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise PanoramaError(
            f"panoramas are not read from {path.suffix or 'files without an ending'}",
            where=path.name,
            advice="give a JPEG, PNG, TIFF, WebP, AVIF, HEIC, OpenEXR (.exr) or Radiance picture (.hdr): a BMP or GIF "
            "saved as PNG; of a raw file, what its camera's program exports",
        )
    return kind


def read_panorama(path: Path, *, k1: float | None = None) -> GivenPanorama:
    """Return the panorama of a file, absolute where the file says so or ``k1`` is given (cd/m2 of the value 1).

    Raises `PictureFileError` for damage and `PanoramaError` for what is no whole equirectangular panorama.
    """
    kind = panorama_format(path)
    light = kind in ("exr", "hdr") or (kind == "tiff" and _of_decimals(path))
    found = _light(path, kind, stated=k1 is None) if light else _photograph(path)
    height, width = found.image.rgb.shape[:2]
    _check_shape(width, height, path.name)
    _check_not_two_circles(found.image.rgb, path.name)
    return _scaled(found, k1, path)


def _scaled(found: GivenPanorama, k1: float | None, path: Path) -> GivenPanorama:
    image = found.image
    if k1 is not None:
        factor, absolute = k1, True
    elif image.absolute:
        return found
    else:
        middle = float(np.median(luminance_cd_m2(image.rgb)))
        photograph = found.factor == WHITE
        factor, absolute = WHITE if photograph or middle <= 0 else MIDDLE / middle, False
    check_light(image.rgb, path, factor)
    rgb = (image.rgb * np.float32(factor)).astype(np.float32)
    return replace(found, image=replace(image, rgb=rgb, absolute=absolute), factor=factor)


def _photograph(path: Path) -> GivenPanorama:
    tags = check_tags(path, read_tags(path))
    codes, said, is_srgb = read_codes(path)
    _check_shape(codes.shape[1], codes.shape[0], path.name)
    codes, notes = (codes, ()) if is_srgb else to_srgb(codes, tags)
    top = float(np.iinfo(codes.dtype).max)
    rgb = linear_of_srgb(codes)
    brightest = codes.max(axis=2)
    validity = np.zeros(brightest.shape, np.uint8)
    validity[brightest <= DARK_SHARE_OF_RANGE * top] = Validity.DARK
    validity[brightest >= CLIPPED_SHARE_OF_RANGE * top] = Validity.CLIPPED
    # That of the unknown tone curve and of rounding to codes, in quadrature
    light = np.maximum(luminance_cd_m2(rgb), np.float32(1e-6))
    # Slope of the sRGB curve's inverse: 1 / 12.92 near black, 2.4 / 1.055 x^(1.4 / 2.4) above.
    slope = np.maximum(1 / 12.92, 2.4 / 1.055 * light ** np.float32(1.4 / 2.4))
    rounding = slope / (top * math.sqrt(12)) / light
    image = LuminanceImage(
        rgb=rgb,
        uncertainty=np.asarray(np.hypot(rounding, TONE_CURVE_UNCERTAINTY), np.float32),
        validity=validity,
        geometry=Equirectangular(rgb.shape[1], rgb.shape[0]),
        scale_uncertainty=0.0,
        absolute=False,
    )
    source = f"{8 * codes.itemsize}-bit {path.suffix[1:].upper()}, through the inverse of the sRGB curve"
    return GivenPanorama(image, source, WHITE, share_of_sphere(validity == Validity.CLIPPED), (*said, *notes))


def _light(path: Path, kind: Format, *, stated: bool) -> GivenPanorama:
    """Return the light of a file, ``stated``: times what the file says of its unit, or Radiance's convention does."""
    if kind == "hdr":
        picture = read_radiance_hdr(path)
        if picture.view:
            raise PanoramaError(f"its VIEW is {picture.view[:60]!r}", where=path.name, advice="give the panorama")
        rgb = picture.rgb if stated else picture.rgb / np.float32(WHITE_EFFICACY_LM_W)
        return _plain(rgb, absolute=picture.absolute, source="Radiance picture")
    if kind == "tiff":
        import cv2

        bgr = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED)
        if bgr is None or bgr.dtype.kind != "f":
            raise PanoramaError("its float values cannot be read", where=path.name, advice="save it as OpenEXR")
        bgr = np.atleast_3d(bgr)
        if bgr.shape[2] == 4:
            refuse_alpha(bgr[..., 3], path.name)
        rgb = bgr[..., 2::-1].astype(np.float32) * np.ones(3, np.float32)
        check_light(rgb, path)
        return _plain(rgb, absolute=False, source="floating-point TIFF, assumed to be linear light")
    part = read_header(path)[0]
    _check_shape(part.width, part.height, path.name)
    if {"uncertainty", "validity"} <= set(part.channels):
        return _own(read_exr(path), path)
    rgb, white = read_exr_rgb(path)
    white = white if stated else None
    said = "" if white is None else f", whiteLuminance {white:g} cd/m2"
    return _plain(rgb * np.float32(white or 1.0), absolute=white is not None, source=f"OpenEXR{said}")


def _of_decimals(path: Path) -> bool:
    """Return whether a TIFF says that it holds floating point numbers (SampleFormat 3, TIFF 6.0), upright and whole.

    Pillow opens no such picture of three channels, so its tags are looked at here."""
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    try:
        with warnings.catch_warnings(), path.open("rb") as file:
            warnings.simplefilter("error")
            tags = ImageFileDirectory_v2(file.read(8))
            file.seek(tags.next)
            tags.load(file)
        check_strips(tags, path.stat().st_size, path.name)
        if found := 3 in tags.get(339, ()) and bool(checked_size(tags[256], tags[257], path.name)):
            check_tags(path, PhotoTags(_gpano(tags.get(700, b"")), tags.get(_ORIENTATION, 1), b""))
        return found
    except (PictureFileError, PanoramaError):
        raise
    except Exception:  # noqa: BLE001 (as above; what is damaged is said when it is read)
        return False


def _own(image: RelativeImage | LuminanceImage, path: Path) -> GivenPanorama:
    if not isinstance(image.geometry, Equirectangular):
        kind, advice = type(image.geometry).__name__.lower(), "give the panorama"
        raise PanoramaError(f"it is a {kind} picture", where=path.name, advice=advice)
    if isinstance(image, RelativeImage):
        image = LuminanceImage(**vars(image), scale_uncertainty=0.0, absolute=False)
    units = "cd/m2" if image.absolute else "relative"
    return GivenPanorama(image, f"daylit's picture, {units}", 1.0, share_of_sphere(image.validity == Validity.CLIPPED))


def _plain(rgb: Floats, *, absolute: bool, source: str) -> GivenPanorama:
    height, width = rgb.shape[:2]
    image = LuminanceImage(
        rgb=np.ascontiguousarray(rgb, np.float32),
        uncertainty=np.full((height, width), LIGHT_UNCERTAINTY, np.float32),
        validity=np.where(rgb.max(axis=2) > 0, np.uint8(Validity.VALID), np.uint8(Validity.DARK)),
        geometry=Equirectangular(width, height),
        scale_uncertainty=0.0,
        absolute=absolute,
    )
    return GivenPanorama(image, f"{source}, {'cd/m2' if absolute else 'no scale'}", 1.0, 0.0)


def _check_shape(width: int, height: int, name: str) -> None:
    if width < LEAST_WIDTH_PX:
        advice = f"at least {LEAST_WIDTH_PX} pixels of width"
        raise PanoramaError(f"it is {width} x {height} pixels", where=name, advice=advice)
    ratio = width / height
    if abs(ratio / 2 - 1) <= ASPECT_TOLERANCE:
        return
    likely = {
        ratio > 2: "a strip that shows only part of floor and ceiling, or a cube map in a row",
        abs(ratio - 1) < 0.02: "an over-under stereo pair, or a single fisheye picture",
        abs(ratio - 4 / 3) < 0.02: "an ordinary photograph, or a cube map",
    }.get(True, "an ordinary photograph, or a part of a panorama")
    text = f"it is {width} x {height} pixels; a whole equirectangular panorama is 2:1"
    advice = "export the whole sphere (360 x 180 degrees), equirectangular"
    raise PanoramaError(text, where=name, likely=likely, advice=advice)


def _check_not_two_circles(rgb: Floats, name: str) -> None:
    """Refuse a camera's two fisheye circles side by side: black outside both, also where a panorama has its poles."""
    luminance: npt.NDArray[Any] = luminance_cd_m2(rgb)
    height, width = luminance.shape
    y = (np.arange(height)[:, None] + 0.5) / height * 2 - 1
    x = ((np.arange(width)[None] + 0.5) / width * 4) % 2 - 1
    outside = np.hypot(x, y) > 1.08
    mean = float(luminance.mean(dtype=np.float64))
    if mean > 0 and float(np.quantile(luminance[outside], 0.98)) <= CIRCLES_BLACK * mean:
        advice = "stitch it with the camera's own software first"
        raise PanoramaError("it shows two fisheye circles, not a stitched panorama", where=name, advice=advice)
