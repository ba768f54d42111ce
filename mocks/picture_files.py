"""The bytes around the picture: EXIF and GPano segments, splicing them into a JPEG, and small CR2 and DNG files."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import numpy.typing as npt
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from mocks.shots import ShotRequest

_BASE, _EXIF = ExifTags.Base, ExifTags.IFD.Exif
_D65, _OTHER_LIGHT = 21, 255
_IMAGE_NUMBER = 0x9211
_XMP_NAMESPACE = b"http://ns.adobe.com/xap/1.0/\0"
_MAX_SEGMENT = 65533


def exif_segment(request: ShotRequest, focal_length_mm: float) -> bytes:
    """Return the APP1 segment with the exposure as a camera writes it: nominal time, local time, sequence, serial."""
    exif = Image.Exif()
    stamp = request.taken_local.strftime("%Y:%m:%d %H:%M:%S")
    exif[_BASE.Make] = request.manufacturer
    exif[_BASE.Model] = request.model
    exif[_BASE.Orientation] = 1
    exif[_BASE.Software] = request.firmware
    exif[_BASE.DateTime] = stamp
    exif.get_ifd(_EXIF).update(_exif_ifd(request, stamp, focal_length_mm))
    return _segment(0xE1, exif.tobytes())


def _exif_ifd(request: ShotRequest, stamp: str, focal_length_mm: float) -> dict[int, object]:
    subsec = f"{request.taken_local.microsecond // 10000:02d}"
    return {
        _BASE.ExposureTime: _rational(request.shutter_s),
        _BASE.FNumber: _rational(request.f_number),
        _BASE.ExposureProgram: 1,
        _BASE.ISOSpeedRatings: request.iso,
        _BASE.ExifVersion: b"0230",
        _BASE.DateTimeOriginal: stamp,
        _BASE.DateTimeDigitized: stamp,
        _BASE.SubsecTimeOriginal: subsec,
        _BASE.SubsecTimeDigitized: subsec,
        _BASE.MeteringMode: 5,
        _BASE.LightSource: _D65 if request.color_temperature_k == 6500 else _OTHER_LIGHT,
        _BASE.FocalLength: _rational(focal_length_mm),
        _BASE.ColorSpace: 1,
        _BASE.ExifImageWidth: request.width_px,
        _BASE.ExifImageHeight: request.height_px,
        _BASE.ExposureMode: 1,
        _BASE.WhiteBalance: 1,
        _BASE.BodySerialNumber: request.serial,
        _IMAGE_NUMBER: request.sequence,
    }


def gpano_segment(width_px: int, height_px: int) -> bytes:
    """Return the APP1 segment with XMP that tells viewers: a full, level equirectangular panorama."""
    size = "".join(
        f' GPano:{name}="{value}"'
        for name, value in (
            ("ProjectionType", "equirectangular"),
            ("UsePanoramaViewer", "True"),
            ("FullPanoWidthPixels", width_px),
            ("FullPanoHeightPixels", height_px),
            ("CroppedAreaImageWidthPixels", width_px),
            ("CroppedAreaImageHeightPixels", height_px),
            ("CroppedAreaLeftPixels", 0),
            ("CroppedAreaTopPixels", 0),
            ("PosePitchDegrees", "0.0"),
            ("PoseRollDegrees", "0.0"),
        )
    )
    packet = (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        f'xmlns:GPano="http://ns.google.com/photos/1.0/panorama/"{size}/></rdf:RDF></x:xmpmeta>'
        '<?xpacket end="r"?>'
    )
    return _segment(0xE1, _XMP_NAMESPACE + packet.encode("utf-8"))


def splice(jpeg: bytes, segments: Sequence[bytes]) -> bytes:
    """Return the JPEG with segments right after its start marker, in place of the JFIF header of the encoder."""
    start = 2
    if jpeg[2:4] == b"\xff\xe0":
        start += 2 + int.from_bytes(jpeg[4:6], "big")
    return b"".join([jpeg[:2], *segments, memoryview(jpeg)[start:]])


def is_whole_jpeg(data: bytes) -> bool:
    """Return whether the bytes begin and end as a JPEG does."""
    return data[:3] == b"\xff\xd8\xff" and data[-2:] == b"\xff\xd9"


def _segment(marker: int, payload: bytes) -> bytes:
    if len(payload) > _MAX_SEGMENT:
        raise ValueError(f"a JPEG segment holds {_MAX_SEGMENT} bytes, not {len(payload)}")
    return struct.pack(">BBH", 0xFF, marker, len(payload) + 2) + payload


def _rational(value: float) -> IFDRational:
    """Return 1/60 for 0.016666…, 56/10 for 5.6."""
    if 0 < value < 0.3:
        return IFDRational(1, round(1 / value))
    fraction = Fraction(value).limit_denominator(10)
    return IFDRational(fraction.numerator, fraction.denominator)


@dataclass(frozen=True)
class RawFrame:
    """A Bayer mosaic (RGGB) as the sensor counted, with its black and white levels."""

    mosaic: npt.NDArray[np.uint16]
    black: int
    white: int


def cr2_file(frame: RawFrame, request: ShotRequest) -> bytes:
    """Return a Canon raw file in outline: TIFF header, ``CR`` 2.0 at byte 8, and the mosaic uncompressed."""
    return _tiff(frame, request, cr2=True)


def dng_file(frame: RawFrame, request: ShotRequest) -> bytes:
    """Return a DNG 1.4: one linear mosaic, uncompressed, with black and white levels."""
    return _tiff(frame, request, cr2=False)


_BYTE, _ASCII, _SHORT, _LONG, _RATIONAL = 1, 2, 3, 4, 5
_WIDTHS = {_BYTE: 1, _ASCII: 1, _SHORT: 2, _LONG: 4, _RATIONAL: 8}
_Entry = tuple[int, int, bytes]


def _tiff(frame: RawFrame, request: ShotRequest, *, cr2: bool) -> bytes:
    """Lay out header, one IFD, its long values, and the strip."""
    start = 16 if cr2 else 8
    entries = sorted([*_common_entries(frame, request), *([] if cr2 else _dng_entries(frame, request))])
    values_at = start + 2 + 12 * len(entries) + 4
    strip_at = values_at + sum(len(v) + len(v) % 2 for _, _, v in entries if len(v) > 4)
    directory, values = [struct.pack("<H", len(entries))], []
    for tag, kind, value in entries:
        data = struct.pack("<I", strip_at) if tag == 273 else value
        count = len(data) // _WIDTHS[kind]
        if len(data) > 4:
            place = struct.pack("<I", values_at)
            values.append(data + b"\0" * (len(data) % 2))
            values_at += len(values[-1])
        else:
            place = data.ljust(4, b"\0")
        directory.append(struct.pack("<HHI", tag, kind, count) + place)
    directory.append(struct.pack("<I", 0))
    header = struct.pack("<2sHI", b"II", 42, start)
    if cr2:
        # Bytes 8..15: "CR", version 2.0, and the place of the directory that describes the raw strip.
        header += struct.pack("<2sBBI", b"CR", 2, 0, start)
    return b"".join([header, *directory, *values, frame.mosaic.astype("<u2").tobytes()])


def _common_entries(frame: RawFrame, request: ShotRequest) -> list[_Entry]:
    height, width = frame.mosaic.shape
    shutter = _rational(request.shutter_s)
    numbers = [(254, 0), (256, width), (257, height), (273, 0), (278, height), (279, 2 * width * height)]
    shorts = [(258, 16), (259, 1), (262, 32803), (274, 1), (277, 1), (34855, request.iso)]
    texts = [
        (271, request.manufacturer),
        (272, request.model),
        (305, request.firmware),
        (306, request.taken_local.strftime("%Y:%m:%d %H:%M:%S")),
    ]
    return [
        *((tag, _LONG, struct.pack("<I", value)) for tag, value in numbers),
        *((tag, _SHORT, struct.pack("<H", value)) for tag, value in shorts),
        *((tag, _ASCII, text.encode("ascii", "replace") + b"\0") for tag, text in texts),
        (33421, _SHORT, struct.pack("<HH", 2, 2)),
        (33422, _BYTE, bytes([0, 1, 1, 2])),
        (33434, _RATIONAL, struct.pack("<II", int(shutter.numerator), int(shutter.denominator))),
    ]


def _dng_entries(frame: RawFrame, request: ShotRequest) -> list[_Entry]:
    return [
        (50706, _BYTE, bytes([1, 4, 0, 0])),
        (50708, _ASCII, request.model.encode("ascii", "replace") + b"\0"),
        (50714, _SHORT, struct.pack("<H", frame.black)),
        (50717, _SHORT, struct.pack("<H", frame.white)),
        (50735, _ASCII, request.serial.encode("ascii", "replace") + b"\0"),
    ]
