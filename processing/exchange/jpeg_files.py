"""JPEG pictures for people and viewers, with XMP that says what they show (docs/reference/files.md)."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes
from processing.pictures.writing import write_bytes

if TYPE_CHECKING:
    from PIL import Image


# A label in the picture itself: whoever sees a staged picture can read that it is one.
#
# Its letters are 3 % of the picture's height, so that it does not vanish in large pictures. On a panorama it stands
# three times, 120 degrees apart and a little below the horizon: a viewer with the usual field always shows one.

TEXT = "Virtually staged"
LETTERS = 0.03
"""Height of a line, of the picture's."""
LEAST_LETTERS_PX = 11
"""Below which letters cannot be read; pictures lower than 370 px get relatively larger ones."""
LATITUDE_DEG = -26.0
"""Of the labels of a panorama."""
TIMES = 3
_PLATE = (16, 16, 20, 200)
_INK = (255, 255, 255, 255)


def labelled(rgb8: Bytes, text: str = TEXT, *, panorama: bool | None = None) -> Bytes:
    """Return a copy of an 8-bit picture (H, W, 3) with the label on it.

    ``panorama``: whether it shows the whole sphere; None: if it is twice as wide as high. The label is made smaller
    where it does not fit; below about 200 pixels of width it cannot be read. Raises `ParameterError` for another array
    and for a text that is empty or longer than 60 characters.
    """
    from PIL import Image

    if rgb8.dtype != np.uint8 or rgb8.ndim != 3 or rgb8.shape[2] != 3 or not rgb8.size:
        raise ParameterError(f"an 8-bit picture is uint8 (H, W, 3), not {rgb8.dtype} {rgb8.shape}")
    if not text.strip() or len(text) > 60 or not text.isprintable():
        raise ParameterError("a label is 1 to 60 printable characters")
    height, width = rgb8.shape[:2]
    round_ = width == 2 * height if panorama is None else panorama
    room_px = width // TIMES if round_ else width
    plate = _plate(text, height, room_px, height // 3 or 1)
    picture = Image.fromarray(np.ascontiguousarray(rgb8)).convert("RGBA")
    for x, y in _places(plate, width, height, whole_sphere=round_):
        picture.alpha_composite(plate, (x, y))
    return np.asarray(picture.convert("RGB"), dtype=np.uint8)


def _places(plate: Image.Image, width: int, height: int, *, whole_sphere: bool) -> list[tuple[int, int]]:
    """Return the upper left corners of the label."""
    if not whole_sphere:
        margin = min(plate.height // 2, width - plate.width, height - plate.height)
        return [(margin, height - plate.height - margin)]
    y = round((0.5 - LATITUDE_DEG / 180) * height - plate.height / 2)
    centres = [(2 * i + 1) / (2 * TIMES) * width for i in range(TIMES)]
    return [(max(0, round(x - plate.width / 2)), min(y, height - plate.height)) for x in centres]


def _plate(text: str, height: int, room_px: int, tallest_px: int) -> Image.Image:
    """Return the label on its dark plate, at most ``room_px`` wide."""
    from PIL import Image, ImageDraw, ImageFont

    size = max(LEAST_LETTERS_PX, round(LETTERS * height))
    font: Any = ImageFont.load_default(size)
    left, top, right, bottom = font.getbbox(text)
    pad = max(2, size // 2)
    plate = Image.new("RGBA", (int(right - left) + 2 * pad, int(bottom - top) + 2 * pad), (0, 0, 0, 0))
    draw = ImageDraw.Draw(plate)
    draw.rounded_rectangle((0, 0, plate.width - 1, plate.height - 1), pad // 2, _PLATE)
    draw.text((pad - left, pad - top), text, fill=_INK, font=font)
    shrink = min(1.0, room_px / plate.width, tallest_px / plate.height)
    if shrink < 1:
        plate = plate.resize((max(1, int(plate.width * shrink)), max(1, int(plate.height * shrink))))
    return plate


# XMP packets by hand: how a panorama covers the sphere (GPano), what kind of picture it is (IPTC), and its title.
#
# Nothing personal goes in: no names, no paths, no times.

GPANO = "http://ns.google.com/photos/1.0/panorama/"
IPTC_EXTENSION = "http://iptc.org/std/Iptc4xmpExt/2008-02-29/"
DAYLIT = "urn:daylit:xmp:1/"
STAGED_SOURCE = "http://cv.iptc.org/newscodes/digitalsourcetype/compositeSynthetic"
"""IPTC's word for pictures of which some elements are synthetic: virtual furniture in a photograph."""

_LONGEST_TITLE = 500


@dataclass(frozen=True)
class PanoramaTags:
    """How an equirectangular picture covers the sphere, in the terms of Google's GPano; angles in degrees."""

    full_width_px: int
    full_height_px: int
    left_px: int = 0
    """Where the picture's left edge lies in the whole panorama."""
    top_px: int = 0
    heading_deg: float | None = None
    """Compass azimuth of the whole panorama's centre column, 0 to 360; None: not known."""
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    initial_heading_deg: float | None = None
    """Compass azimuth (from the centre where no heading is known) at which a viewer opens."""

    def __post_init__(self) -> None:
        if not (0 < self.full_width_px <= 1 << 20 and self.full_width_px == 2 * self.full_height_px):
            raise ParameterError(f"a whole panorama of {self.full_width_px} x {self.full_height_px} is not 2 : 1")
        if self.left_px < 0 or self.top_px < 0:
            raise ParameterError("a crop begins within the panorama", advice="give left and top from 0")
        angles = (self.heading_deg, self.pitch_deg, self.roll_deg, self.initial_heading_deg)
        if not all(math.isfinite(angle) for angle in angles if angle is not None):
            raise ParameterError("an angle of the panorama is no number")

    @classmethod
    def whole(cls, width_px: int, height_px: int, *, heading_rad: float | None = None) -> PanoramaTags:
        """Return the tags of a picture of the whole sphere; ``heading_rad``: azimuth of its centre column."""
        return cls(width_px, height_px, heading_deg=None if heading_rad is None else math.degrees(heading_rad))


def packet(
    width_px: int,
    height_px: int,
    *,
    panorama: PanoramaTags | None = None,
    staged: bool = False,
    relative: bool = False,
    title: str = "",
) -> bytes:
    """Return an XMP packet for a picture of this size, UTF-8; empty where there is nothing to say.

    ``staged``: it shows furniture that was not there. ``relative``: it was made from light of unknown scale. Raises
    `ParameterError` for a panorama that the picture does not fit into, and for a title above 500 characters.
    """
    attributes = {} if panorama is None else _panorama(panorama, width_px, height_px)
    if staged:
        attributes |= {"Iptc4xmpExt:DigitalSourceType": STAGED_SOURCE, "daylit:Staged": "True"}
    if relative:
        attributes["daylit:Units"] = "relative"
    if not attributes and not title:
        return b""
    names = {"GPano": GPANO, "Iptc4xmpExt": IPTC_EXTENSION, "daylit": DAYLIT, "dc": "http://purl.org/dc/elements/1.1/"}
    spaces = " ".join(f'xmlns:{name}="{uri}"' for name, uri in names.items())
    properties = " ".join(f"{name}={quoteattr(value)}" for name, value in attributes.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {spaces} {properties}>{_title(title)}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
    ).encode()


def _panorama(tags: PanoramaTags, width_px: int, height_px: int) -> dict[str, str]:
    beyond = tags.left_px + width_px > tags.full_width_px or tags.top_px + height_px > tags.full_height_px
    if beyond:
        raise ParameterError(
            f"a picture of {width_px} x {height_px} reaches beyond its panorama of "
            f"{tags.full_width_px} x {tags.full_height_px}"
        )
    values: dict[str, int | float | str] = {
        "ProjectionType": "equirectangular",
        "UsePanoramaViewer": "True",
        "CroppedAreaImageWidthPixels": width_px,
        "CroppedAreaImageHeightPixels": height_px,
        "FullPanoWidthPixels": tags.full_width_px,
        "FullPanoHeightPixels": tags.full_height_px,
        "CroppedAreaLeftPixels": tags.left_px,
        "CroppedAreaTopPixels": tags.top_px,
        "PosePitchDegrees": tags.pitch_deg,
        "PoseRollDegrees": tags.roll_deg,
    }
    if tags.heading_deg is not None:
        values["PoseHeadingDegrees"] = tags.heading_deg % 360
    if tags.initial_heading_deg is not None:
        values["InitialViewHeadingDegrees"] = round(tags.initial_heading_deg) % 360
    return {f"GPano:{name}": _text(value) for name, value in values.items()}


def _text(value: float | str) -> str:
    return f"{round(value, 4) + 0.0:.10g}" if isinstance(value, float) else str(value)


def _title(title: str) -> str:
    if not title:
        return ""
    if len(title) > _LONGEST_TITLE:
        raise ParameterError(f"a title of {len(title)} characters", advice=f"at most {_LONGEST_TITLE}")
    # XML has no control characters, not even escaped.
    plain = "".join(c if c.isprintable() else " " for c in title)
    return f'<dc:title><rdf:Alt><rdf:li xml:lang="x-default">{escape(plain)}</rdf:li></rdf:Alt></dc:title>'


LONGEST_SIDE_PX = 65_500
"""Of JPEG."""


def jpeg_bytes(
    rgb8: Bytes,
    *,
    panorama: PanoramaTags | None = None,
    staged: bool = False,
    relative: bool = False,
    title: str = "",
    quality: int = 92,
) -> bytes:
    """Return a JPEG (4:4:4) of an 8-bit sRGB picture (H, W, 3) with an XMP packet; see `xmp.packet`.

    Raises `ParameterError` for another array, a size that JPEG cannot have, a quality outside 1 to 95, and a panorama
    that the picture does not fit into.
    """
    from PIL import Image

    if rgb8.dtype != np.uint8 or rgb8.ndim != 3 or rgb8.shape[2] != 3 or not rgb8.size:
        raise ParameterError(f"an 8-bit picture is uint8 (H, W, 3), not {rgb8.dtype} {rgb8.shape}")
    if max(rgb8.shape[:2]) > LONGEST_SIDE_PX:
        raise ParameterError(f"a JPEG is at most {LONGEST_SIDE_PX} pixels wide and high", advice="make it smaller")
    if not 1 <= quality <= 95:
        raise ParameterError(f"a JPEG quality of {quality}", advice="1 to 95")
    height, width = rgb8.shape[:2]
    xmp = packet(width, height, panorama=panorama, staged=staged, relative=relative, title=title)
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb8)).save(out, "JPEG", quality=quality, subsampling=0, xmp=xmp)
    return out.getvalue()


def write_jpeg(
    path: Path,
    rgb8: Bytes,
    *,
    panorama: PanoramaTags | None = None,
    staged: bool = False,
    relative: bool = False,
    title: str = "",
    quality: int = 92,
) -> None:
    """Write a picture (H, W, 3) sRGB as `jpeg_bytes` durably.

    ``staged``: furniture was added; ``relative``: the light's scale is unknown.
    """
    data = jpeg_bytes(rgb8, panorama=panorama, staged=staged, relative=relative, title=title, quality=quality)
    write_bytes(path, data)
