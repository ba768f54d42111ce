"""A tiny shot source: small real JPEGs with EXIF, made by Pillow."""

from __future__ import annotations

import io

from PIL import Image
from PIL.ExifTags import IFD, Base

from mocks.instruments.exposures import ShotRequest


class TinyShots:
    """Grey pictures whose brightness follows the exposure; ``padding`` bytes follow the end-of-image marker."""

    def __init__(self, padding: int = 0) -> None:
        self.padding = padding
        self.requests: list[ShotRequest] = []

    def jpeg(self, request: ShotRequest) -> bytes:
        self.requests.append(request)
        exif = Image.Exif()
        exif[Base.Make], exif[Base.Model] = request.manufacturer, request.model
        exif.get_ifd(IFD.Exif).update(
            {
                Base.ExposureTime: request.shutter_s,
                Base.FNumber: request.f_number,
                Base.ISOSpeedRatings: request.iso,
                Base.DateTimeOriginal: request.taken_local.strftime("%Y:%m:%d %H:%M:%S"),
            }
        )
        level = 40 + (request.sequence * 37) % 180
        out = io.BytesIO()
        Image.new("RGB", (64, 32), (level, level, level)).save(out, "JPEG", exif=exif)
        return out.getvalue() + b"\0" * self.padding

    def raw(self, request: ShotRequest) -> bytes:
        return b"II*\0" + request.sequence.to_bytes(4, "little") * 100


def exposure_time(jpeg: bytes) -> float:
    """Return the exposure time of the EXIF, in seconds."""
    with Image.open(io.BytesIO(jpeg)) as picture:
        return float(picture.getexif().get_ifd(IFD.Exif)[Base.ExposureTime])
