"""XMP packets by hand: how a panorama covers the sphere (GPano), what kind of picture it is (IPTC), and its title.

Nothing personal goes in: no names, no paths, no times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

from processing.errors import ParameterError

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
    told = " ".join(f"{name}={quoteattr(value)}" for name, value in attributes.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" {spaces} {told}>{_title(title)}</rdf:Description>'
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
