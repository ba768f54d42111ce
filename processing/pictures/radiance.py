"""Radiance pictures (.hdr) for ``evalglare``, ``falsecolor`` and ``pvalue``: value / 179, EXPOSURE, VIEW, RGBE.

Radiance takes luminance as 179 (0.265 R + 0.670 G + 0.065 B) whatever a file's PRIMARIES say; our weights are those
of Rec. 709. A blue sky would come out 2 % darker. So each pixel is written times (our luminance / Radiance's): grey
stays as it is, hue and saturation too, and every tool of Radiance finds the luminance of the picture in cd/m2.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from processing.errors import PictureFileError
from processing.ground.arrays import Bytes, Floats, Vector
from processing.pictures.exr import CHROMATICITIES
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage
from processing.pictures.writing import check_image, check_light, check_size, refused, write_bytes
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, Perspective

_FIT = 1e-6  # rounding error
_SMALLEST = 1e-32  # below this Radiance stores black
_EXPONENT_BIAS = 128  # of RGBE (Ward 1991)
_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Of the plane's most even additive sequence (Roberts 2018, R2): neighbours get thresholds far from each other."""
RLE_WIDTHS = range(8, 32768)  # that have the new run-length code (color.c)
WHITE_EFFICACY_LM_W = 179.0  # Radiance's color.h
RADIANCE_WEIGHTS = (0.265, 0.670, 0.065)  # as ``evalglare`` and ``pvalue -b`` use them (Radiance, src/common/color.h)
MARK = "daylit_luminance=radiance-weights"
_COLOURS = {"COLORCORR": ((1, 1, 1), 0, 1e-6), "PRIMARIES": (CHROMATICITIES, 0, 0.025)}
"""What such lines may say, and tolerances: Radiance's own primaries (green 0.29, equal-energy white) pass; chosen.
Eight zeros, which Photoshop writes, state no primaries."""
RELATIVE_MARK = "daylit_units=relative"
"""In the header of a picture whose scale nothing gave: its values are no watts, and not to be taken for cd/m2."""

_MAX_FILE_BYTES, _MAX_HEADER_BYTES = 1 << 31, 1 << 20  # chosen
_ROWS = 128  # at a time, for memory


def view_of(geometry: Geometry, where: Path | str) -> str:
    """Return the options of Radiance's VIEW line for a geometry; empty for the whole sphere, which has none.

    Raises `PictureFileError` where Radiance has no such view.
    """
    if isinstance(geometry, Equirectangular):
        return ""
    if isinstance(geometry, Perspective):
        return _perspective_view(geometry, where)
    middle = (geometry.width_px / 2, geometry.height_px / 2)
    centre = geometry.centre_px or middle
    if max(abs(c - m) for c, m in zip(centre, middle, strict=True)) > 1e-3 or geometry.width_px != geometry.height_px:
        raise _no_view(where, "a fisheye that is not centred in a square")
    reach = geometry.width_px / 2 / geometry.radius_px
    if geometry.mapping is LensMapping.EQUIDISTANT and reach * geometry.half_field_rad <= math.pi:
        kind, degrees = "-vta", math.degrees(2 * reach * geometry.half_field_rad)
    elif geometry.mapping is LensMapping.ORTHOGRAPHIC and reach * math.sin(geometry.half_field_rad) <= 1 + _FIT:
        kind = "-vth"
        degrees = math.degrees(2 * math.asin(min(1.0, reach * math.sin(geometry.half_field_rad))))
    else:
        raise _no_view(where, f"this {geometry.mapping} fisheye")
    up = _vector(math.sin(geometry.top_azimuth_rad), math.cos(geometry.top_azimuth_rad), 0.0)
    return f"{kind} -vp 0 0 0 -vd 0 0 1 -vu {up} -vh {degrees:.9g} -vv {degrees:.9g}"


def _perspective_view(geometry: Perspective, where: Path | str) -> str:
    flat = math.cos(geometry.pitch_rad)
    if geometry.roll_rad or flat < _FIT:
        raise _no_view(where, "a perspective view that is rolled or looks straight up or down")
    ahead = _vector(flat * math.sin(geometry.yaw_rad), flat * math.cos(geometry.yaw_rad), math.sin(geometry.pitch_rad))
    tall = 2 * math.atan(math.tan(geometry.fov_x_rad / 2) * geometry.height_px / geometry.width_px)
    angles = f"-vh {math.degrees(geometry.fov_x_rad):.9g} -vv {math.degrees(tall):.9g}"
    return f"-vtv -vp 0 0 0 -vd {ahead} -vu 0 0 1 {angles}"


def _vector(*values: float) -> str:
    return " ".join(f"{round(value, 12) + 0.0:.12g}" for value in values)


def _no_view(where: Path | str, what: str) -> PictureFileError:
    text = f"Radiance has no view for {what}"
    return refused(where, text, advice="project it to an equidistant or orthographic fisheye that fills a square first")


def geometry_of(view: str, width: int, height: int) -> Fisheye | None:
    """Return the fisheye that a view's options describe; None for other views and for none at all.

    Taken are ``-vta`` and ``-vth`` with one angle both ways in a square picture. A direction that is not given is taken
    as upwards: the tools that make such pictures of skies leave it out.
    """
    words = view.split()
    kinds = {"-vta": LensMapping.EQUIDISTANT, "-vth": LensMapping.ORTHOGRAPHIC}
    mapping = next((kinds[word] for word in words if word in kinds), None)
    try:
        across, along = (float(words[words.index(name) + 1]) for name in ("-vh", "-vv"))
        ahead = _numbers(words, "-vd", (0.0, 0.0, 1.0))
        up = _numbers(words, "-vu", (0.0, 1.0, 0.0))
    except (ValueError, IndexError):
        return None
    limit = 360 if mapping is LensMapping.EQUIDISTANT else 180
    level = math.hypot(ahead[0], ahead[1]) > _FIT * ahead[2]
    if mapping is None or width != height or across != along or not 0 < across <= limit or level:
        return None
    # Where up is along the direction itself, as Radiance's default is, the picture's top is taken as +y.
    top = math.atan2(up[0], up[1]) if math.hypot(up[0], up[1]) > _FIT else 0.0
    return Fisheye(width, height, mapping, width / 2, math.radians(across / 2), None, top)


def _numbers(words: list[str], name: str, default: Vector) -> Vector:
    if name not in words:
        return default
    place = words.index(name)
    x, y, z = (float(word) for word in words[place + 1 : place + 4])
    return x, y, z


# Radiance's RGBE pixels and their run-length code (Ward 1991, "Real pixels"; the new run-length code of 1991).
#
# A pixel's three mantissas share the exponent of the largest. Readers take the middle of a step (+ 0.5). Rounding is
# spread by a fixed pattern, so that an even surface keeps its mean: without it a uniform sky is off by up to 0.4 %.


class RunLengthError(ValueError):
    """Bytes that are no picture rows."""


def to_rgbe(rgb: Floats, first_row: int = 0) -> Bytes:
    """Return (H, W, 4) bytes of float32 (H, W, 3) values; ``first_row``: where these rows stand in their picture.

    A channel of 0 beside a brighter one reads as half a step: the format has no other way.
    """
    height, width = rgb.shape[:2]
    largest = np.maximum(np.maximum(rgb[..., 0], rgb[..., 1]), rgb[..., 2])
    # The exponent of IEEE 754 as it lies in the bits; from it, in the same way, 2 to the power of 8 - exponent.
    stored = np.maximum(largest, np.float32(_SMALLEST)).view(np.int32) >> 23
    scale = ((261 - stored) << 23).view(np.float32)
    threshold = _fractions(first_row, height, _STEPS[1])[:, None] + _fractions(0, width, _STEPS[0])
    threshold -= threshold >= 1
    threshold -= np.float32(0.5)
    out = np.empty((height, width, 4), dtype=np.uint8)
    for channel in range(3):
        mantissa = rgb[..., channel] * scale
        mantissa += threshold
        # One that the pattern would lift to 256 stays at 255; one that it would push below 0 stays at 0.
        out[..., channel] = np.clip(mantissa, 0, 255, out=mantissa)
    out[..., 3] = np.clip(stored + (_EXPONENT_BIAS - 126), 0, 255)
    # What the pattern pushed below 128 the format has with twice the mantissa; every other is one more, for the mean.
    low = np.nonzero(out[..., :3].max(axis=2) < 128)
    out[low] = np.column_stack(
        [2 * out[low][:, :3] + ((low[0] + low[1]) % 2).astype(np.uint8)[:, None], out[low][:, 3] - 1]
    )
    out[largest < _SMALLEST] = 0
    return out


def _fractions(first: int, count: int, step: float) -> Floats:
    return np.asarray(np.arange(first, first + count) * step % 1.0, dtype=np.float32)


def from_rgbe(rgbe: Bytes) -> Floats:
    """Return float32 (H, W, 3) of (H, W, 4) bytes: the middle of each step, and 0 where the exponent is 0."""
    exponent = rgbe[..., 3].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(np.float32(1), exponent - (_EXPONENT_BIAS + 8)), np.float32(0))
    return np.asarray((rgbe[..., :3] + np.float32(0.5)) * scale[..., None], dtype=np.float32)


def encode_rows(rgbe: Bytes) -> bytes:
    """Return rows of pixels in the new run-length code, or flat where their width has no such code.

    ``rgbe``: (H, W, 4), as `to_rgbe` makes it: OpenCV, which encodes the rows, then finds the same bytes again.
    """
    scale = np.ldexp(np.float32(1), rgbe[..., 3:].astype(np.int32) - (_EXPONENT_BIAS + 8))
    data = cv2.imencode(".hdr", rgbe[..., 2::-1] * scale)[1].tobytes()
    return data[data.index(b"\n", data.index(b"\n\n") + 2) + 1 :]


def decode_rows(data: bytes, width: int, height: int) -> Bytes:
    """Return (H, W, 4) bytes of pixel data, run-length coded or flat.

    Raises `RunLengthError` for data that end early, go on, overrun a row, or use the run-length code of before 1991.
    """
    if width not in RLE_WIDTHS or data[:2] != b"\2\2" or data[2:3] >= b"\x80":
        if len(data) != 4 * width * height:
            raise RunLengthError(f"{len(data)} bytes are not {width} x {height} pixels")
        out = np.frombuffer(data, dtype=np.uint8).reshape(height, width, 4)
        if bool((out[..., :3] == 1).all(axis=2).any()):
            raise RunLengthError("it uses the pre-1991 run-length code, or is damaged")
        return out
    out = np.empty((height, 4, width), dtype=np.uint8)
    mark, place = bytes((2, 2, width >> 8, width & 255)), 0
    for row in out:
        if data[place : place + 4] != mark:
            raise RunLengthError("a row does not start with a row header")
        place += 4
        for component in row:
            line, place = _decode_line(data, place, width)
            component[:] = np.frombuffer(line, dtype=np.uint8)
    if place != len(data):
        raise RunLengthError(f"{len(data) - place} bytes follow the last row")
    return np.ascontiguousarray(out.transpose(0, 2, 1))


def _decode_line(data: bytes, place: int, width: int) -> tuple[bytearray, int]:
    """Return one component of one row, and where the next begins."""
    line = bytearray()
    end = len(data)
    while len(line) < width:
        code = data[place] if place < end else 0
        if code > 128:
            line += data[place + 1 : place + 2] * (code - 128)
            place += 2
        elif code:
            line += data[place + 1 : place + 1 + code]
            place += 1 + code
        if code == 0 or place > end:
            raise RunLengthError("a row ends early")
    if len(line) != width:
        raise RunLengthError("a row overruns its width")
    return line, place


@dataclass(frozen=True)
class RadiancePicture:
    """A Radiance file's light: without validity and uncertainty, so it is no `LuminanceImage`."""

    rgb: Floats
    """(H, W, 3): cd/m2 (value x 179, EXPOSURE divided out), Rec. 709."""
    view: str
    """The last VIEW line without its name, or empty."""
    geometry: Geometry | None
    """What the view says, where it is a fisheye that looks up."""
    exposure: float
    header: tuple[str, ...]
    """All lines of the header."""

    @property
    def absolute(self) -> bool:
        """Whether daylit wrote the values as cd/m2; other programs' files do not say what their values are."""
        return MARK in self.header and RELATIVE_MARK not in self.header


def write_radiance_hdr(path: Path, image: LuminanceImage) -> None:
    """Write a picture in cd/m2 as Radiance RGBE, durably; step of the code: at most 0.8 % of a pixel's largest channel.

    Raises `PictureFileError` for a picture that breaks its type's promises, and for a geometry that has no view in
    Radiance (equisolid, polynomial, rolled, off-centre; anything but a fisheye, perspective or equirectangular).
    """
    check_image(image, path)
    width, height = image.geometry.width_px, image.geometry.height_px
    view = view_of(image.geometry, path)
    lines = ["#?RADIANCE", "SOFTWARE= daylit", MARK, "FORMAT=32-bit_rle_rgbe", "EXPOSURE=1"]
    lines += [] if image.absolute else [RELATIVE_MARK]
    lines += [f"VIEW= {view}"] if view else []
    blocks = ["\n".join([*lines, "", f"-Y {height} +X {width}", ""]).encode("ascii")]
    for top in range(0, height, _ROWS):
        rows = image.rgb[top : top + _ROWS]
        gain = _ratio(rows, LUMINANCE_WEIGHTS, RADIANCE_WEIGHTS) * np.float32(1 / WHITE_EFFICACY_LM_W)
        blocks.append(encode_rows(to_rgbe(rows * gain[..., None], top)))
    write_bytes(path, b"".join(blocks))


def read_radiance_hdr(path: Path) -> RadiancePicture:
    """Read an RGBE picture: of daylit (the inverse of `write_radiance_hdr`), or of others (values taken as Rec. 709).

    Raises `PictureFileError` for damage (rows that end early, overrun or go on), XYZE, turned or mirrored rows,
    colour-corrected files and other PRIMARIES than Rec. 709's.
    """
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise refused(path, f"is larger than {_MAX_FILE_BYTES} bytes")
        data = path.read_bytes()
    except OSError as error:
        raise refused(path, f"cannot be read ({error.strerror})") from error
    lines, width, height, start = _header(data, path)
    exposure = _exposure(lines, path)
    try:
        rgbe = decode_rows(data[start:], width, height)
    except RunLengthError as error:
        raise refused(path, f"is damaged: {error}", likely="cut off or overwritten", advice="copy it again") from error
    rgb = from_rgbe(rgbe)
    check_light(rgb, path, WHITE_EFFICACY_LM_W / exposure)
    rgb *= np.float32(WHITE_EFFICACY_LM_W / exposure)
    if MARK in lines:
        rgb *= _ratio(rgb, RADIANCE_WEIGHTS, LUMINANCE_WEIGHTS)[..., None]
    views = [line.partition("=")[2].strip() for line in lines if line.startswith("VIEW=")]
    view = views[-1] if views else ""
    return RadiancePicture(rgb, view, geometry_of(view, width, height), exposure, tuple(lines))


def _ratio(rgb: Floats, above: tuple[float, ...], below: tuple[float, ...]) -> Floats:
    """Return luminance by one set of weights over that by another, (H, W); 1 where it is black."""
    over, under = (rgb @ np.array(weights, dtype=np.float32) for weights in (above, below))
    return np.asarray(np.divide(over, under, out=np.ones_like(over), where=under > 0), dtype=np.float32)


def _header(data: bytes, path: Path) -> tuple[list[str], int, int, int]:
    """Return the header's lines, width, height, and where the pixels begin."""
    if not data.startswith(b"#?"):
        raise refused(path, "is not a Radiance picture")
    end = data.find(b"\n\n", 0, _MAX_HEADER_BYTES)
    stop = data.find(b"\n", end + 2, end + 80)
    if end < 0 or stop < 0:
        raise refused(path, "has a damaged header", likely="cut short or overwritten")
    lines = data[:end].decode("utf-8", "replace").split("\n")
    size = re.fullmatch(rb"-Y +([0-9]{1,9}) +\+X +([0-9]{1,9})", data[end + 2 : stop].strip())
    if size is None:
        raise refused(path, f"has the size {data[end + 2 : stop]!r}; '-Y height +X width' is taken")
    height, width = (int(value) for value in size.groups())
    check_size(width, height, path)
    formats = [line.partition("=")[2].strip() for line in lines if line.startswith("FORMAT=")]
    if any(one != "32-bit_rle_rgbe" for one in formats):
        raise refused(path, f"has the format {formats[-1]}", advice="convert it with ra_xyze -r")
    return lines, width, height, stop + 1


def _exposure(lines: list[str], path: Path) -> float:
    """Return the product of all EXPOSURE lines; refuse colours that are not those of Rec. 709."""
    exposure = 1.0
    for line in lines:
        name, _, value = line.partition("=")
        try:
            if name == "EXPOSURE":
                exposure *= float(value)
            stated = np.array(value.split(), float) if name in _COLOURS else np.zeros(8)
            same = (len(stated) == 8 and not stated.any()) or np.allclose(stated, *_COLOURS[name])
        except ValueError:
            exposure, same = math.nan, name == "EXPOSURE"
        if not same:
            advice = "convert it: ra_xyze -r -p .64 .33 .3 .6 .15 .06 .3127 .329 (pfilt first, of COLORCORR)"
            raise refused(path, f"has the colours {name}={value[:99]}, not those of Rec. 709", advice=advice)
    if not (math.isfinite(exposure) and exposure > 0):
        raise refused(path, "has an EXPOSURE that is not a positive number")
    return exposure
