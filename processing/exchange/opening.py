"""Any picture, opened to be looked at: what its values are, in which unit, and what else the file says."""

from __future__ import annotations

from processing.ground.arrays import Bytes, Floats

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from processing.errors import PictureFileError
from processing.exr_files import read_exr, read_exr_rgb
from processing.images import LuminanceImage, RelativeImage
from processing.picture_panorama_tags import read_tags
from processing.radiance_files import read_radiance_hdr
from processing.sphere import Equirectangular, Geometry

CODE_UNIT = "8-bit sRGB"
"""Of JPEG and PNG: what is shown, not light."""
MOST_8BIT_BYTES = 1 << 30


@dataclass(frozen=True)
class OpenPicture:
    """A picture and what is known of it."""

    kind: str
    """In words: what made it, and whether its values are light."""
    unit: str
    """cd/m2, relative units, or `CODE_UNIT` (mean of the three codes stands for luminance then)."""
    rgb: Floats
    """(H, W, 3)."""
    geometry: Geometry | None
    """None where the file does not say."""
    uncertainty: Floats | None = None
    validity: Bytes | None = None
    scale_uncertainty: float | None = None
    attributes: Mapping[str, object] = field(default_factory=dict)

    @property
    def is_light(self) -> bool:
        """Tell whether values are linear light."""
        return self.unit != CODE_UNIT


def open_picture(path: Path) -> OpenPicture:
    """Open an EXR, Radiance HDR, JPEG or PNG picture; raises `PictureFileError` for what is none or is damaged."""
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise PictureFileError(f"cannot be read ({error.strerror})", where=str(path)) from error
    if head.startswith(b"\x76\x2f\x31\x01"):
        return _exr(path)
    if head.startswith(b"#?"):
        return _radiance(path)
    if head.startswith((b"\xff\xd8", b"\x89PNG")):
        return _eight_bit(path)
    raise PictureFileError(
        "is no picture that can be inspected", where=str(path), advice="give EXR, Radiance HDR, JPEG or PNG"
    )


def _exr(path: Path) -> OpenPicture:
    try:
        image = read_exr(path)
    except PictureFileError as error:
        if "is not a picture of daylit" not in str(error):
            raise
        rgb, white = read_exr_rgb(path)
        told = {} if white is None else {"whiteLuminance": white}
        scaled = rgb if white is None else rgb * np.float32(white)
        unit = "relative units" if white is None else "cd/m2"
        return OpenPicture("OpenEXR of another program", unit, scaled, _assumed(rgb), attributes=told)
    attributes = dict(image.attributes)
    if isinstance(image, RelativeImage):
        kind, unit, scale = "daylit: merged, before calibration", "relative units", None
    else:
        assert isinstance(image, LuminanceImage)
        kind, unit, scale = "daylit: calibrated", image.unit, image.scale_uncertainty
    return OpenPicture(kind, unit, image.rgb, image.geometry, image.uncertainty, image.validity, scale, attributes)


def _radiance(path: Path) -> OpenPicture:
    picture = read_radiance_hdr(path)
    attributes: dict[str, object] = {"exposure": picture.exposure, "view": picture.view or "none"}
    attributes["header"] = list(picture.header)
    unit = "cd/m2" if picture.absolute else "relative units"
    geometry = picture.geometry or (None if picture.view else _assumed(picture.rgb))
    return OpenPicture("Radiance HDR", unit, picture.rgb, geometry, attributes=attributes)


def _eight_bit(path: Path) -> OpenPicture:
    from PIL import Image, UnidentifiedImageError

    try:
        if path.stat().st_size > MOST_8BIT_BYTES:
            raise OSError("it is too large")
        with Image.open(path, formats=("JPEG", "PNG")) as image:
            codes = np.asarray(image.convert("RGB"), dtype=np.float32)
            packet = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
    except (OSError, UnidentifiedImageError, ValueError, Image.DecompressionBombError) as error:
        raise PictureFileError(f"cannot be read: {error}", where=str(path)) from error
    text = packet.encode() if isinstance(packet, str) else bytes(packet)
    attributes: dict[str, object] = {f"GPano:{name}": value for name, value in read_tags(path).gpano.items()}
    attributes["staged"] = b"compositeSynthetic" in text
    if b'daylit:Units="relative"' in text:
        attributes["units"] = "relative"
    return OpenPicture("JPEG or PNG, to look at", CODE_UNIT, codes, _assumed(codes), attributes=attributes)


def _assumed(rgb: Floats) -> Geometry | None:
    """Return a whole panorama for a picture twice as wide as high."""
    height, width = rgb.shape[:2]
    return Equirectangular(width, height) if width == 2 * height else None
