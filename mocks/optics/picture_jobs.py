"""The work of rendering, as functions that a worker process can run: image bands, exposures, mosaics."""

import io
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from mocks.instruments.exposures import ShotRequest
from mocks.optics.camera import CameraOptics, centres, image_rows
from mocks.optics.lenses import EquirectangularLens, Size, TwoFisheyes
from mocks.optics.sensor import Exposure
from mocks.worlds.light import World
from processing.ground.arrays import Flags, Floats, UInt16s

# The bytes around the picture: EXIF and GPano segments, splicing them into a JPEG, and small CR2 and DNG files.

_BASE, _EXIF = ExifTags.Base, ExifTags.IFD.Exif
_D65, _OTHER_LIGHT = 21, 255
_IMAGE_NUMBER = 0x9211  # EXIF's tag of that name
_XMP_NAMESPACE = b"http://ns.adobe.com/xap/1.0/\0"
_MAX_SEGMENT = 65533  # of JPEG: two bytes hold the length, itself included


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
    """Return the APP1 segment with XMP that says to viewers: a full, level equirectangular panorama."""
    facts = {"ProjectionType": "equirectangular", "UsePanoramaViewer": "True"}
    facts |= {f"FullPano{side}Pixels": str(px) for side, px in (("Width", width_px), ("Height", height_px))}
    facts |= {f"CroppedAreaImage{side}Pixels": str(px) for side, px in (("Width", width_px), ("Height", height_px))}
    facts |= {"CroppedAreaLeftPixels": "0", "CroppedAreaTopPixels": "0"}
    facts |= {"PosePitchDegrees": "0.0", "PoseRollDegrees": "0.0"}
    size = "".join(f' GPano:{name}="{value}"' for name, value in facts.items())
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

    mosaic: UInt16s
    black: int
    white: int
    matrix: tuple[tuple[float, float, float], ...]
    """Its channels of linear Rec. 709: a DNG states them of CIE XYZ."""


RGB_OF_XYZ = ((3.2410, -1.5374, -0.4986), (-0.9692, 1.8760, 0.0416), (0.0556, -0.2040, 1.0570))
"""IEC 61966-2-1, Annex D."""
_BYTE, _ASCII, _SHORT, _LONG, _RATIONAL, _SIGNED = 1, 2, 3, 4, 5, 10
_WIDTHS = {_BYTE: 1, _ASCII: 1, _SHORT: 2, _LONG: 4, _RATIONAL: 8, _SIGNED: 8}
_Entry = tuple[int, int, bytes]


def mosaic_file(frame: RawFrame, request: ShotRequest, *, cr2: bool) -> bytes:
    """Return a raw file of one linear mosaic, uncompressed: a Canon's in outline (TIFF header, ``CR`` 2.0 at byte 8),
    else a DNG 1.4 with black and white levels."""
    # Lay out header, one IFD, its long values, and the strip
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
    of_xyz = np.array(frame.matrix) @ np.array(RGB_OF_XYZ)
    rationals = np.stack([np.rint(of_xyz.ravel() * 10_000), np.full(9, 10_000)], axis=1)
    return [
        (50721, _SIGNED, rationals.astype("<i4").tobytes()),
        (50778, _SHORT, struct.pack("<H", 21)),  # D65
        (50706, _BYTE, bytes([1, 4, 0, 0])),
        (50708, _ASCII, request.model.encode("ascii", "replace") + b"\0"),
        (50714, _SHORT, struct.pack("<H", frame.black)),
        (50717, _SHORT, struct.pack("<H", frame.white)),
        (50735, _ASCII, request.serial.encode("ascii", "replace") + b"\0"),
    ]


# Chosen: the light of a band takes 5 MB.
_BAND_PX = 400_000
_EXPOSE_ROWS = 32  # chosen: a band that stays in the cache
_PIXEL_BYTES = 12  # three float32


@dataclass(frozen=True)
class ImageJob:
    """A whole image to be rendered into a file.

    The file holds a plane for each component of the world's light, rows of float32 RGB; then the mean image of each
    lens and component (3 float32).
    """

    world: World
    optics: CameraOptics
    size: Size
    path: Path


@dataclass(frozen=True)
class PictureJob:
    """One exposure of a rendered image; ``weights`` are those of the planes during that exposure."""

    optics: CameraOptics
    size: Size
    image: Path
    exposure: Exposure
    weights: tuple[float, ...]
    seed: int


def bands(size: Size) -> list[range]:
    """Return the bands of rows that an image is rendered in: small, so that memory stays small."""
    step = max(4, _BAND_PX // size[0])
    return [range(first, min(first + step, size[1])) for first in range(0, size[1], step)]


def _behind(optics: CameraOptics, width: int) -> Flags:
    """Return the columns (W,) that a panorama camera's second lens sees; none of other cameras'."""
    ahead = np.abs((np.arange(width) + 0.5) / width - 0.5) < 0.25
    return ~ahead if isinstance(optics.lens, EquirectangularLens) else np.zeros(width, dtype=bool)


def render_band(job: ImageJob, rows: range) -> tuple[Floats, Floats]:
    """Render a band into its places; return light of shape (2, N, 3) by lens and plane, cd, and solid angles, sr."""
    width, height = job.size
    x, y = centres(job.size, rows)
    behind = _behind(job.optics, width)
    weight = job.optics.lens.solid_angle_sr(x, y, job.size) * np.stack([~behind, behind])[:, None]
    totals = []
    with job.path.open("r+b") as file:
        for plane in range(len(job.world.components)):
            light = image_rows(job.world, job.optics, job.size, rows, plane)
            file.seek((plane * height + rows.start) * width * _PIXEL_BYTES)
            file.write(light.data)
            totals.append(np.einsum("ijk,lij->lk", light, weight, dtype=np.float64))
    solid = weight.sum(axis=(1, 2), dtype=np.float64)
    return np.stack(totals, axis=1).astype(np.float32), solid.astype(np.float32)


def finish_image(job: ImageJob, parts: list[tuple[Floats, Floats]]) -> None:
    """Append each lens's mean image of each plane to the file, from bands of shape (2, N, 3) and solid angles."""
    light, solid = (sum(np.asarray(part[k], np.float64) for part in parts) for k in (0, 1))
    mean = light / np.maximum(solid, 1e-12)[:, None, None]
    with job.path.open("r+b") as file:
        file.seek(len(job.world.components) * job.size[0] * job.size[1] * _PIXEL_BYTES)
        file.write(np.asarray(mean, dtype=np.float32).tobytes())


def expose(job: PictureJob) -> bytes:
    """Return the JPEG of one exposure, without EXIF."""
    width, height = job.size
    picture = np.empty((height, width, 3), dtype=np.uint8)
    for rows, signal in _signals(job):
        picture[rows.start : rows.stop] = job.optics.sensor.develop(signal, job.exposure)
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "JPEG", quality=job.optics.jpeg_quality, subsampling="4:2:2")
    return out.getvalue()


def mosaic(job: PictureJob, step: int) -> UInt16s:
    """Return a small Bayer mosaic (RGGB) of the exposure, every ``step``-th pixel, in raw counts.

    A panorama camera's shows its two lenses.
    """
    width, height = job.size
    rng = np.random.default_rng([job.seed, 1 << 32])
    file = _ImageFile(job)
    rows = np.concatenate([file.light(range(row, row + 1))[:, ::step] for row in range(0, height, step)])
    light = rows[: height // step // 2 * 2, : width // step // 2 * 2]
    if isinstance(job.optics.lens, EquirectangularLens):
        light = TwoFisheyes().picture(rows, light.shape[0])
    signal = job.optics.sensor.mosaic_signal(light, job.exposure, rng)
    bayer = signal[..., 1].copy()
    bayer[::2, ::2] = signal[::2, ::2, 0]
    bayer[1::2, 1::2] = signal[1::2, 1::2, 2]
    sensor = job.optics.sensor
    white = 2**sensor.raw_bits - 1
    counts = sensor.raw_black + bayer * (white - sensor.raw_black)
    return np.asarray(np.clip(np.rint(counts), 0, white), dtype=np.uint16)


def _signals(job: PictureJob) -> Iterator[tuple[range, Floats]]:
    """Yield the sensor's signal, a few rows at a time; each has its own random numbers."""
    file, height = _ImageFile(job), job.size[1]
    for first in range(0, height, _EXPOSE_ROWS):
        rows = range(first, min(first + _EXPOSE_ROWS, height))
        rng = np.random.Generator(np.random.SFC64([job.seed, first]))
        yield rows, job.optics.sensor.mosaic_signal(file.light(rows), job.exposure, rng)


class _ImageFile:
    """The light of an exposure, read from the image's file: weighted planes under the veil of glare."""

    def __init__(self, job: PictureJob) -> None:
        self._job = job
        width, height = job.size
        means = np.fromfile(job.image, np.float32, offset=len(job.weights) * width * height * _PIXEL_BYTES)
        veils = np.float32(job.optics.glare) * (np.array(job.weights, np.float32) @ means.reshape(2, -1, 3))
        # What comes through a lens is scattered over that lens's sensor.
        self._veil = veils[_behind(job.optics, width).astype(int)]

    def light(self, rows: range) -> Floats:
        """Return rows of light (H, W, 3), cd/m2."""
        keep = 1 - self._job.optics.glare
        light = self._plane(0, rows, keep)
        for plane in range(1, len(self._job.weights)):
            light += self._plane(plane, rows, keep)
        if keep != 1:
            light += self._veil
        return light

    def _plane(self, plane: int, rows: range, keep: float) -> Floats:
        width, height = self._job.size
        start = (plane * height + rows.start) * width * _PIXEL_BYTES
        light = np.fromfile(self._job.image, np.float32, len(rows) * width * 3, offset=start)
        factor = keep * self._job.weights[plane]
        if factor != 1:
            light *= np.float32(factor)
        return light.reshape(len(rows), width, 3)
