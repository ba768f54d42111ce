"""What a picture says: as a whole, and at a place of the sphere with what lies around it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import ParameterError, PictureFileError
from processing.ground.arrays import Bytes, Doubles, Floats
from processing.pictures.exr import read_any_exr
from processing.pictures.frames import refuse_early_end
from processing.pictures.images import LuminanceImage, RelativeImage, Validity, luminance_cd_m2
from processing.pictures.panorama import read_tags
from processing.pictures.radiance import read_radiance_hdr
from processing.sphere import Equirectangular, Fisheye, Geometry, directions, pixels, solid_angles

# Any picture, opened to be looked at: what its values are, in which unit, and what else the file says.

CODE_UNIT = "8-bit sRGB"  # of JPEG and PNG: what is shown, not light
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
    raise PictureFileError("cannot be inspected", where=str(path), advice="give EXR, Radiance HDR, JPEG or PNG")


def _exr(path: Path) -> OpenPicture:
    image = read_any_exr(path)
    if isinstance(image, tuple):
        rgb, white = image
        attributes: dict[str, object] = {} if white is None else {"whiteLuminance": white}
        scaled = rgb if white is None else rgb * np.float32(white)
        unit = "relative units" if white is None else "cd/m2"
        return OpenPicture("OpenEXR from another program", unit, scaled, _assumed(rgb), attributes=attributes)
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
            deep = image.mode.startswith("I")  # grey of 16 bits, which Pillow would cut off at 255
            codes = np.asarray(image if deep else image.convert("RGB"), dtype=np.float32)
            codes = np.repeat(codes[..., None] / 257, 3, axis=2) if deep else codes
            packet = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or b""
    except (OSError, UnidentifiedImageError, ValueError, Image.DecompressionBombError) as error:
        raise PictureFileError(f"cannot be read: {error}", where=str(path)) from error
    refuse_early_end(path.read_bytes(), str(path))
    text = packet.encode() if isinstance(packet, str) else bytes(packet)
    attributes: dict[str, object] = {f"GPano:{name}": value for name, value in read_tags(path).gpano.items()}
    attributes |= {"edited": b"compositeSynthetic" in text, "staged": b'daylit:Staged="True"' in text}
    attributes |= {"units": "relative"} if b'daylit:Units="relative"' in text else {}
    return OpenPicture("JPEG or PNG, for viewing", CODE_UNIT, codes, _assumed(codes), attributes=attributes)


def _assumed(rgb: Floats) -> Geometry | None:
    """Return a whole panorama for a picture twice as wide as high."""
    height, width = rgb.shape[:2]
    return Equirectangular(width, height) if width == 2 * height else None


Facts = dict[str, Any]
WORDS = {code.value: code.name.lower() for code in Validity}


def picture_facts(picture: OpenPicture) -> Facts:
    """Return size, geometry, unit, metadata and the range of a picture's luminance, as plain values.

    Median and mean are by solid angle where the projection is known.
    """
    height, width = picture.rgb.shape[:2]
    level = _level(picture)
    chosen = np.ones(level.shape, bool) if picture.validity is None else picture.validity != Validity.OUTSIDE
    facts: Facts = {"kind": picture.kind, "unit": picture.unit, "width_px": width, "height_px": height}
    facts |= {"geometry": _named(picture), "scale_uncertainty": picture.scale_uncertainty}
    area = np.ones(level.shape) if picture.geometry is None else solid_angles(picture.geometry)
    facts |= {"range": _range(level[chosen], area[chosen]), "attributes": dict(picture.attributes)}
    if picture.validity is not None:
        count = np.bincount(picture.validity.ravel(), minlength=max(WORDS) + 1) / picture.validity.size
        facts["pixels"] = {name: float(count[code]) for code, name in WORDS.items()}
    return facts


def place_facts(picture: OpenPicture, lon_deg: float, lat_deg: float, radius_deg: float = 1.0) -> Facts:
    """Return the pixel at a direction, and statistics of what lies within a radius of it, by solid angle.

    Longitude 0 is the panorama's centre, to the right positive; latitude up. The uncertainty is the pixel's own and
    the scale's together, relative. Raises `ParameterError` for a picture whose projection is not known, and for a
    direction that it does not show.
    """
    if picture.geometry is None:
        raise ParameterError("it does not state its projection", advice="a panorama is 2:1")
    if not (-180 <= lon_deg <= 360 and -90 <= lat_deg <= 90 and 0 < radius_deg <= 90):
        raise ParameterError("longitude -180 to 360, latitude -90 to 90, radius up to 90 degrees")
    lon, lat = math.radians(lon_deg), math.radians(lat_deg)
    ray = np.array([math.cos(lat) * math.sin(lon), math.cos(lat) * math.cos(lon), math.sin(lat)])
    x, y, seen = pixels(picture.geometry, ray)
    if not bool(seen):
        raise ParameterError(f"the picture does not show longitude {lon_deg:g}, latitude {lat_deg:g}")
    height, width = picture.rgb.shape[:2]
    column, row = min(int(x), width - 1), min(int(y), height - 1)
    level = _level(picture)
    facts: Facts = {"longitude_deg": lon_deg, "latitude_deg": lat_deg, "column": column, "row": row}
    rgb = [float(v) for v in picture.rgb[row, column]]
    facts |= {"rgb": rgb, "value": float(level[row, column]), "unit": picture.unit}
    if picture.uncertainty is not None and picture.validity is not None:
        total = math.hypot(float(picture.uncertainty[row, column]), picture.scale_uncertainty or 0.0)
        facts["relative_uncertainty"] = total if math.isfinite(total) else None
        facts["pixel"] = WORDS.get(int(picture.validity[row, column]), "unknown")
    facts["around"] = _around(picture, level, ray, radius_deg)
    return facts


def _around(picture: OpenPicture, level: Floats, ray: Doubles, radius_deg: float) -> Facts | None:
    """Return statistics within the radius; None where not a single pixel's middle lies in it."""
    assert picture.geometry is not None
    rays, seen = directions(picture.geometry)
    near = seen & (rays @ ray >= math.cos(math.radians(radius_deg)))
    if picture.validity is not None:
        near &= picture.validity != Validity.OUTSIDE
    if not near.any():
        return None
    values, weights = level[near].astype(np.float64), solid_angles(picture.geometry)[near]
    weights = weights if weights.sum() > 0 else np.ones_like(weights)
    mean = float(np.average(values, weights=weights))
    spread = math.sqrt(float(np.average((values - mean) ** 2, weights=weights)))
    found = {"radius_deg": radius_deg, "pixels": int(near.sum()), "mean": mean, "standard_deviation": spread}
    return found | {"lowest": float(values.min()), "highest": float(values.max())}


def _level(picture: OpenPicture) -> Floats:
    """Return luminance (H, W); of codes their mean."""
    codes = picture.unit == CODE_UNIT
    return picture.rgb.mean(axis=2, dtype=np.float32) if codes else luminance_cd_m2(picture.rgb)


def _range(tone: Floats, area: Doubles) -> Facts:
    if not area.any():
        return {"lowest": None, "median": None, "mean": None, "highest": None}
    median = float(np.quantile(tone, 0.5, weights=area, method="inverted_cdf"))
    mean = float(np.average(tone, weights=area))
    return {"lowest": float(tone.min()), "median": median, "mean": mean, "highest": float(tone.max())}


def _named(picture: OpenPicture) -> str:
    if picture.geometry is None:
        return "not known"
    if isinstance(picture.geometry, Equirectangular):
        return "equirectangular panorama"
    if isinstance(picture.geometry, Fisheye):
        degrees = math.degrees(2 * picture.geometry.half_field_rad)
        return f"{picture.geometry.mapping.value} fisheye of {degrees:.1f} degrees, looking up"
    return f"perspective view of {math.degrees(picture.geometry.fov_x_rad):.1f} degrees"
