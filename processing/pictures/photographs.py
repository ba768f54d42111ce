"""Any ordinary picture as RGB codes: JPEG, PNG, TIFF, WebP, AVIF, HEIC; grey, palette, CMYK, Lab, 16 bits, opaque.

Frames of a bracket are read more strictly (`processing.pictures.frames`), which does all that is RGB already. What
has no single meaning as a picture of light, transparency above all, is refused with what to do.
"""

from __future__ import annotations

import io
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from processing.errors import PictureFileError
from processing.pictures.frames import MAX_PIXELS, Codes, checked_size, damaged_picture, frame_of, refuse_alpha

if TYPE_CHECKING:
    from PIL.Image import Image

Kind = Literal["jpeg", "png", "tiff", "webp", "avif", "heic"]
KINDS: dict[str, Kind] = {
    ".jpg": "jpeg",
    ".jpeg": "jpeg",
    ".png": "png",
    ".tif": "tiff",
    ".tiff": "tiff",
    ".webp": "webp",
    ".avif": "avif",
    ".heic": "heic",
    ".heif": "heic",
}
PILLOW = {"jpeg": "JPEG", "png": "PNG", "tiff": "TIFF", "webp": "WEBP", "avif": "AVIF", "heic": "HEIF"}
"""Pillow's names of the formats."""
CURVES = {8: "linear", 16: "HDR video's (PQ or HLG)", 18: "HDR video's (PQ or HLG)"}
"""Of ITU-T H.273's transfer characteristics, those that are far from sRGB's."""
_NCLX, _CICP = re.compile(rb"colrnclx..(..)", re.DOTALL), re.compile(rb"\0\0\0\x04cICP.(.)", re.DOTALL)
"""Where AVIF (ISO/IEC 14496-12, 12.1.5) and PNG (PNG 3, 11.3.2.6) state one: Pillow does not say."""


def read_codes(path: Path) -> tuple[Codes, tuple[str, ...], bool]:
    """Return the codes (H, W, 3), uint8 or uint16, what there is to say, and whether they are sRGB for certain.

    Raises `PictureFileError`: damaged, too large, partly transparent, or not of whole numbers.
    """
    kind = KINDS[path.suffix.lower()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with _opened(path, kind) as image:
                checked_size(*image.size, path.name)
                if curve := _other_curve(image, path, kind):
                    advice = "save it with the sRGB curve (without HDR), or as OpenEXR"
                    raise PictureFileError(f"its tone curve is {curve}", where=path.name, advice=advice)
                notes = ("it holds several pictures: the first is used",) if getattr(image, "n_frames", 1) > 1 else ()
                if kind in ("webp", "avif", "heic") or image.mode in ("CMYK", "LAB"):
                    codes, more, is_srgb = _rgb(image, path)
                    return codes, (*notes, *more), is_srgb
        except PictureFileError:
            raise
        except Exception as error:  # Pillow raises nearly anything over damaged files
            raise damaged_picture(path.name, str(error)) from error
    return frame_of(path).decode(), notes, False


def _opened(path: Path, kind: Kind) -> Image:
    from PIL import Image

    if PILLOW[kind] not in pillow_formats():
        advice = "install daylit[heic], or save it as JPEG (on a phone: camera format 'most compatible')"
        raise PictureFileError("HEIC needs an optional part", where=path.name, advice=advice)
    try:
        return Image.open(io.BytesIO(path.read_bytes()), formats=(PILLOW[kind],))
    except OSError as error:
        raise damaged_picture(path.name, error.strerror or f"its content is not {kind.upper()}") from error


def _other_curve(image: Image, path: Path, kind: Kind) -> str | None:
    """Return the tone curve that a file states, where that is far from sRGB's (or a profile's).

    Of several, as of a picture beside its gain map, all must be. In a PNG cICP counts before iCCP, sRGB and gAMA, of
    which programs write 1/2.2 for sRGB; what differs by more than a twentieth is another curve (chosen)."""
    where, nclx = {"avif": _NCLX, "png": _CICP}.get(kind), image.info.get("nclx_profile") or {}
    found = where.findall(path.read_bytes()) if where else [bytes([nclx.get("transfer_characteristics", 0)])]
    stated = {int.from_bytes(one) for one in found}
    if stated and stated <= CURVES.keys():
        return CURVES[max(stated)]
    gamma = image.info.get("gamma", 1 / 2.2)
    known = stated or {"srgb", "icc_profile"} & image.info.keys() or abs(2.2 * gamma - 1) < 0.05
    return None if known else f"gamma {gamma:.3g} (gAMA), not sRGB's"


def pillow_formats() -> tuple[str, ...]:
    """Return Pillow's names of the formats that can be read here: HEIC needs the extra ``daylit[heic]``."""
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = MAX_PIXELS  # Pillow's own limit calls larger ones bombs; `checked_size` names the size
    try:
        from pillow_heif import register_heif_opener
    except ImportError:
        return tuple(name for name in PILLOW.values() if name != "HEIF")
    register_heif_opener()
    return tuple(PILLOW.values())


def _rgb(image: Image, path: Path) -> tuple[Codes, tuple[str, ...], bool]:
    from PIL import ImageCms

    if image.mode in ("CMYK", "LAB"):
        try:
            given = io.BytesIO(image.info.get("icc_profile") or b"")
            source = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB") if image.mode == "LAB" else given)
            turned = ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"), outputMode="RGB")
            assert turned is not None
            name = ImageCms.getProfileDescription(source).strip()[:80]
            return np.asarray(turned, np.uint8), (f"converted from {name!r} to sRGB",), True
        except (ImageCms.PyCMSError, OSError, ValueError):
            note = "CMYK without a readable profile: colours are approximate"
            return np.asarray(image.convert("RGB"), np.uint8), (note,), True
    if image.has_transparency_data:
        whole = np.asarray(image.convert("RGBA"), np.uint8)
        refuse_alpha(whole[..., 3], path.name)
        return np.ascontiguousarray(whole[..., :3]), (), False
    return np.asarray(image.convert("RGB"), np.uint8), (), False
