"""What a photograph's own tags say of a panorama: projection and crop (GPano), orientation (EXIF), colours (ICC)."""

from __future__ import annotations

import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from processing.errors import PanoramaError
from processing.frames import Codes

MAX_XMP_BYTES = 1 << 20
MAX_PROFILE_BYTES = 4 << 20
_ORIENTATION = 274
_TAG = re.compile(rb"GPano:(\w{1,64})(?:\s*=\s*[\"']|\s*>)\s*([^\"'<]{1,64})")


@dataclass(frozen=True)
class PhotoTags:
    """What was found; empty where nothing is said."""

    gpano: dict[str, str]
    """Properties of the namespace GPano of the XMP packet."""
    orientation: int
    profile: bytes
    """ICC."""


def read_tags(path: Path) -> PhotoTags:
    """Return the tags of a JPEG or PNG; what cannot be read counts as not said (the pixels are checked elsewhere)."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path, formats=("JPEG", "PNG")) as image:
                profile = image.info.get("icc_profile") or b""
                packet = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
                orientation = image.getexif().get(_ORIENTATION, 1)
    except Exception:  # noqa: BLE001 (Pillow raises nearly anything over damaged files)
        return PhotoTags({}, 1, b"")
    raw = packet.encode("utf-8", "replace") if isinstance(packet, str) else bytes(packet)
    return PhotoTags(
        gpano={key.decode(): value.decode("utf-8", "replace") for key, value in _TAG.findall(raw[:MAX_XMP_BYTES])},
        orientation=orientation if isinstance(orientation, int) else 1,
        profile=profile if len(profile) <= MAX_PROFILE_BYTES else b"",
    )


def check_tags(path: Path) -> PhotoTags:
    """Return the tags; `PanoramaError` where they say that the file is no whole, upright equirectangular panorama."""
    tags = read_tags(path)
    kind = tags.gpano.get("ProjectionType", "equirectangular")
    if kind.lower() != "equirectangular":
        raise PanoramaError(
            f"its tags say that its projection is {kind!r}", where=path.name, advice="export it equirectangular"
        )
    for side in ("Width", "Height"):
        whole, part = (_pixels(tags.gpano.get(name.format(side))) for name in _SIZES)
        if whole and part and part < whole:
            raise PanoramaError(
                f"its tags say that it is a part: {part} of {whole} pixels of {side.lower()}",
                where=path.name,
                advice="export the whole sphere",
            )
    if tags.orientation not in (0, 1):
        raise PanoramaError(
            f"its tags say that it is to be turned (orientation {tags.orientation})",
            where=path.name,
            advice="save it upright",
        )
    return tags


_SIZES = ("FullPano{}Pixels", "CroppedAreaImage{}Pixels")


def _pixels(text: str | None) -> int | None:
    return int(text) if text and text.strip().isdecimal() else None


def to_srgb(codes: Codes, tags: PhotoTags) -> tuple[Codes, tuple[str, ...]]:
    """Return the codes in sRGB, and what there is to say: another profile is converted (8 bits) or told of."""
    if not tags.profile:
        return codes, ()
    from PIL import Image, ImageCms

    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(tags.profile))
        name = ImageCms.getProfileDescription(profile).strip()[:80]
    except (ImageCms.PyCMSError, OSError, ValueError):
        return codes, ("its colour profile cannot be read: taken as sRGB",)
    if "srgb" in name.lower():
        return codes, ()
    if codes.dtype != np.uint8:
        return codes, (f"its colour profile is {name!r}: taken as sRGB, so colours are a little off",)
    try:
        turned = ImageCms.profileToProfile(Image.fromarray(codes), profile, ImageCms.createProfile("sRGB"))
    except (ImageCms.PyCMSError, ValueError):
        return codes, (f"its colour profile {name!r} is not one for RGB: taken as sRGB",)
    return np.asarray(turned, np.uint8), (f"converted from {name!r} to sRGB",)
