"""JPEG pictures for people and viewers, with XMP that says what they show (docs/reference/files.md)."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypedDict, Unpack
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes
from processing.ground.tables import table_of
from processing.pictures.panorama import ASPECT_TOLERANCE
from processing.pictures.preview import check_rgb8
from processing.pictures.writing import write_bytes

if TYPE_CHECKING:
    from PIL import Image


# A label in the picture itself: whoever sees a staged or emptied picture can read that it is one.
#
# In a flat picture it is a small plate in the lower left corner. On a panorama it lies flat on the floor at the nadir
# and on the ceiling at the zenith, where it hides no furniture and is not bent. Where there is a link it has a QR code.

TEXT = "Virtually staged"
LETTERS = 0.022  # height of a line, of the picture's. Chosen: read on a phone, and no more.
LEAST_LETTERS_PX = 11  # below which letters cannot be read; pictures lower than 500 px get relatively larger ones
POLE_HALF_FIELD = 0.42
"""Tangent of half the plate's width at a pole: 0.67 m of floor to either side of a camera at 1.6 m. Chosen."""
LEAST_PANORAMA_PX = 64  # high, under which a pole has no room for letters: the label is a flat picture's
_PLATE = (16, 16, 20, 150)
_INK = (255, 255, 255, 235)
LONGEST_SIDE_PX = 65_500  # of JPEG


def labelled(rgb8: Bytes, text: str = TEXT, *, panorama: bool | None = None, link: str | None = None) -> Bytes:
    """Return a copy of an 8-bit picture (H, W, 3) with the label on it.

    ``panorama``: whether it shows the whole sphere; None: if it is twice as wide as high. ``link``: where a QR code
    beside the text leads. The label is made smaller where it does not fit; below about 200 pixels of width it cannot be
    read. Raises `ParameterError` for another array and for a text that is empty or longer than 60 characters.
    """
    from PIL import Image

    check_rgb8(rgb8)
    if not text.strip() or len(text) > 60 or not text.isprintable():
        raise ParameterError("a label is 1 to 60 printable characters")
    height, width = rgb8.shape[:2]
    if height >= LEAST_PANORAMA_PX and (width == 2 * height if panorama is None else panorama):
        return _at_the_poles(rgb8, text, link)
    plate = _plate(text, height, width, height // 3 or 1, link)
    picture = Image.fromarray(np.ascontiguousarray(rgb8)).convert("RGBA")
    margin = min(max(LEAST_LETTERS_PX, height // 60), width - plate.width, height - plate.height)
    picture.alpha_composite(plate, (max(margin, 0), height - plate.height - max(margin, 0)))
    return np.asarray(picture.convert("RGB"), dtype=np.uint8)


def _at_the_poles(rgb8: Bytes, text: str, link: str | None) -> Bytes:
    """Return a panorama with the plate flat at nadir and zenith, to be read by who looks down or up from the middle."""
    import cv2

    rows, columns = rgb8.shape[:2]
    out = rgb8.copy()
    longitude = ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * math.pi
    reach = max(1, math.ceil(math.atan(POLE_HALF_FIELD * 1.1) / math.pi * rows))
    plate = np.asarray(_plate(text, max(24 * LEAST_LETTERS_PX, rows), columns, rows, link), np.float32)
    high, wide = plate.shape[:2]
    for top in (False, True):
        away = np.tan((np.arange(reach) + 0.5) / rows * math.pi)  # from the pole, on a plane one unit away
        part = slice(0, reach) if top else slice(rows - reach, rows)
        away = away if top else away[::-1]
        across, ahead = away[:, None] * np.sin(longitude), away[:, None] * np.cos(longitude)
        x = (across / POLE_HALF_FIELD + 1) * wide / 2 - 0.5
        y = high / 2 - 0.5 + (1 if top else -1) * ahead / POLE_HALF_FIELD * wide / 2
        seen = cv2.remap(plate, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderValue=0)
        share = seen[..., 3:] / 255
        out[part] = np.round(out[part] * (1 - share) + seen[..., :3] * share)
    return out


def _plate(text: str, height: int, room_px: int, tallest_px: int, link: str | None = None) -> Image.Image:
    """Return the label on its dark plate, at most ``room_px`` wide, with a QR code of a link above it."""
    from PIL import Image, ImageDraw, ImageFont

    size = max(LEAST_LETTERS_PX, round(LETTERS * height))
    font: Any = ImageFont.load_default(size)
    left, top, right, bottom = font.getbbox(text)
    pad = max(2, size // 2)
    code = None if link is None else _qr(link, height)
    above = 0 if code is None else code.height + pad
    plate = Image.new("RGBA", (int(right - left) + 2 * pad, int(bottom - top) + 2 * pad + above), (0, 0, 0, 0))
    draw = ImageDraw.Draw(plate)
    draw.rounded_rectangle((0, 0, plate.width - 1, plate.height - 1), pad // 2, _PLATE)
    draw.text((pad - left, above + pad - top), text, fill=_INK, font=font)
    if code is not None:
        plate.paste(code, (pad, pad))
    shrink = min(1.0, room_px / plate.width, tallest_px / plate.height)
    if shrink < 1:
        plate = plate.resize((max(1, int(plate.width * shrink)), max(1, int(plate.height * shrink))))
    return plate


def _qr(link: str, height: int) -> Image.Image:
    """Return the QR code of a link, about an eleventh of the picture's height, with its quiet zone."""
    import segno
    from PIL import Image

    modules = np.array([list(row) for row in segno.make(link, error="m", micro=False).matrix_iter(border=4)], np.uint8)
    scale = max(2, round(height / 11 / len(modules)))
    return Image.fromarray(np.kron(255 * (1 - modules), np.ones((scale, scale), np.uint8))).convert("RGBA")


# What a picture is: as the camera took it, or changed by computer. It says so on its plate, in its metadata and in its
# statement, with where the unaltered original is (California AB 723, in force since 2026-01-01; listing services).

PHOTOGRAPH, EMPTIED, STAGED = "photograph", "emptied", "staged"
FURNITURE, EQUIPMENT = "furniture", "equipment"
"""What was removed: furniture, whatever went with it; or no more than the photographer's things and direct sunlight."""
PLATES = {PHOTOGRAPH: "", EMPTIED: "Furniture removed", STAGED: TEXT, EQUIPMENT: "Retouched"}
EDITS: dict[str, str] = table_of(__package__, "edits")
"""Behind the bar: what is said only where the light was recalculated (`Made.lit`)."""


class Made(NamedTuple):
    """What a picture is, and all that it says of that."""

    state: str = PHOTOGRAPH
    """`PHOTOGRAPH`, `EMPTIED` or `STAGED`."""
    removed: str = FURNITURE
    """Of an emptied or staged one: `FURNITURE`, `EQUIPMENT`, or nothing."""
    further: str = ""
    """relit, computed view, or neither."""
    original: str = ""
    """Where the unaltered photograph is: an address on the web, or a file beside the picture; empty: not known."""
    lit: bool = True
    """Whether the light of an emptied or staged room was recalculated."""

    @classmethod
    def of(cls, name: str, **more: Any) -> Self:
        """Return what is shown under a name: room, empty, staged-2; Photograph, Emptied, Staged 2."""
        low = name.lower()
        return cls(STAGED if low.startswith(STAGED) else EMPTIED if low.startswith("empt") else PHOTOGRAPH, **more)

    @property
    def plate(self) -> str:
        """Return the text of its label; empty: as the camera took it."""
        own = EQUIPMENT if (self.state, self.removed) == (EMPTIED, EQUIPMENT) else self.state
        return ", ".join(filter(None, (PLATES[own], self.further))).capitalize()

    @property
    def statement(self) -> str:
        """Return what was changed, and where the unaltered original is; empty: as the camera took it."""
        edits = ["added"] * (self.state == STAGED) + [self.removed] * (self.state != PHOTOGRAPH)
        edits = [self.state] if self.removed == FURNITURE else edits
        known = (EDITS[one].split("|") for one in (*edits, self.further) if one in EDITS)
        said = " ".join("".join(parts[: 1 + self.lit]) + "." for parts in known)
        return f"{said} Unaltered original: {self.original}" if said and self.original else said

    def on(self, rgb8: Bytes, *, panorama: bool | None = None) -> Bytes:
        """Return an 8-bit picture (H, W, 3) with its label, if it is to have one; see `labelled`."""
        link = self.original if self.original.startswith("http") else None
        return labelled(rgb8, self.plate, panorama=panorama, link=link) if self.plate else np.ascontiguousarray(rgb8)


def removed_by(facts: Mapping[str, Any]) -> str:
    """Return what the stage remove took away (`Made.removed`), by its result; empty: nothing."""
    if facts.get("skipped") or "empty" in facts["left_out"]:
        return ""
    return FURNITURE if facts["metrics"].get("furniture", True) else EQUIPMENT


def lit_by(state: str, facts: Callable[[str], Mapping[str, Any]]) -> bool:
    """Return whether the light of a state was recalculated (`Made.lit`), by what remove and render say they did."""
    removed = facts("remove")
    lifted = not removed.get("skipped") and "lift" not in removed["left_out"]
    return lifted or state.startswith(STAGED)


# XMP packets by hand: how a panorama covers the sphere (GPano), what kind of picture it is (IPTC), and its title.
#
# Nothing personal goes in: no names, no paths, no times.

GPANO = "http://ns.google.com/photos/1.0/panorama/"
IPTC_EXTENSION = "http://iptc.org/std/Iptc4xmpExt/2008-02-29/"
DAYLIT = "urn:daylit:xmp:1/"
DIGITAL_SOURCE = "http://cv.iptc.org/newscodes/digitalsourcetype/"
STAGED_SOURCE = DIGITAL_SOURCE + "compositeSynthetic"
"""IPTC's word for pictures of which some elements are synthetic: virtual furniture, or a floor that nobody saw."""

_LONGEST_TITLE = 600  # chosen: a session's name may have 500, and what is shown and when follows it


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
        off_px = abs(self.full_width_px - 2 * self.full_height_px)
        if not (0 < self.full_width_px <= 1 << 20 and off_px <= ASPECT_TOLERANCE * self.full_width_px):
            raise ParameterError(f"a whole panorama must be 2:1, not {self.full_width_px} x {self.full_height_px}")
        if self.left_px < 0 or self.top_px < 0:
            raise ParameterError("a crop begins within the panorama", advice="give left and top from 0")
        angles = (self.heading_deg, self.pitch_deg, self.roll_deg, self.initial_heading_deg)
        if not all(math.isfinite(angle) for angle in angles if angle is not None):
            raise ParameterError("an angle of the panorama is not a number")

    @classmethod
    def whole(cls, width_px: int, height_px: int, *, heading_rad: float | None = None) -> PanoramaTags:
        """Return the tags of a picture of the whole sphere; ``heading_rad``: azimuth of its centre column."""
        return cls(width_px, height_px, heading_deg=None if heading_rad is None else math.degrees(heading_rad))


class Said(TypedDict, total=False):
    """What a picture says of itself."""

    panorama: PanoramaTags | None
    made: Made
    relative: bool
    """It was made from light of unknown scale."""
    title: str


def packet(width_px: int, height_px: int, **said: Unpack[Said]) -> bytes:
    """Return an XMP packet for a picture of this size, UTF-8; empty where there is nothing to say.

    Raises `ParameterError` for a panorama that the picture does not fit into, and for a title above 600 characters.
    """
    panorama, title, made = said.get("panorama"), said.get("title", ""), said.get("made", Made())
    attributes, statement = {} if panorama is None else _panorama(panorama, width_px, height_px), made.statement
    if statement:
        attributes |= {"Iptc4xmpExt:DigitalSourceType": STAGED_SOURCE, "daylit:State": made.state}
        attributes |= {"daylit:Staged": "True"} if made.state == STAGED else {}
    if said.get("relative"):
        attributes["daylit:Units"] = "relative"
    if not attributes and not title and not statement:
        return b""
    names = {"GPano": GPANO, "Iptc4xmpExt": IPTC_EXTENSION, "daylit": DAYLIT, "dc": "http://purl.org/dc/elements/1.1/"}
    spaces = " ".join(f'xmlns:{name}="{uri}"' for name, uri in names.items())
    properties = " ".join(f"{name}={quoteattr(value)}" for name, value in attributes.items())
    texts = _text_of("title", title) + _text_of("description", statement)
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {spaces} {properties}>{texts}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta><?xpacket end="r"?>'
    ).encode()


def _panorama(tags: PanoramaTags, width_px: int, height_px: int) -> dict[str, str]:
    if tags.left_px + width_px > tags.full_width_px or tags.top_px + height_px > tags.full_height_px:
        whole = f"{tags.full_width_px} x {tags.full_height_px}"
        raise ParameterError(f"a picture of {width_px} x {height_px} reaches beyond its panorama of {whole}")
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
    numbers = {name: f"{round(v, 4) + 0.0:.10g}" for name, v in values.items() if isinstance(v, float)}
    return {f"GPano:{name}": numbers.get(name, str(value)) for name, value in values.items()}


def _text_of(name: str, text: str) -> str:
    """Return a text as Dublin Core has it: title, description."""
    if not text:
        return ""
    if len(text) > _LONGEST_TITLE:
        raise ParameterError(f"a {name} of {len(text)} characters", advice=f"at most {_LONGEST_TITLE}")
    # XML has no control characters, not even escaped.
    plain = "".join(c if c.isprintable() else " " for c in text)
    return f'<dc:{name}><rdf:Alt><rdf:li xml:lang="x-default">{escape(plain)}</rdf:li></rdf:Alt></dc:{name}>'


def jpeg_bytes(rgb8: Bytes, *, quality: int = 92, **said: Unpack[Said]) -> bytes:
    """Return a JPEG (4:4:4) of an 8-bit sRGB picture (H, W, 3) with an XMP packet; see `packet`.

    Raises `ParameterError` for another array, a size that JPEG cannot have, a quality outside 1 to 95, and a panorama
    that the picture does not fit into.
    """
    from PIL import Image

    check_rgb8(rgb8)
    if max(rgb8.shape[:2]) > LONGEST_SIDE_PX:
        raise ParameterError(f"a JPEG is at most {LONGEST_SIDE_PX} pixels wide and high", advice="make it smaller")
    if not 1 <= quality <= 95:
        raise ParameterError(f"a JPEG quality of {quality}", advice="1 to 95")
    xmp = packet(rgb8.shape[1], rgb8.shape[0], **said)
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rgb8)).save(out, "JPEG", quality=quality, subsampling=0, xmp=xmp)
    return out.getvalue()


def write_jpeg(path: Path, rgb8: Bytes, *, quality: int = 92, **said: Unpack[Said]) -> None:
    """Write a picture (H, W, 3) sRGB as `jpeg_bytes` durably."""
    write_bytes(path, jpeg_bytes(rgb8, quality=quality, **said))
