"""Radiance's RGBE pixels and their run-length code (Ward 1991, "Real pixels"; the new run-length code of 1991).

A pixel's three mantissas share the exponent of the largest. Readers take the middle of a step (+ 0.5). Rounding is
spread by a fixed pattern, so that an even surface keeps its mean: without it a uniform sky is off by up to 0.4 %.
"""

from __future__ import annotations

from processing.ground.arrays import Bytes, Floats

import numpy as np


_SMALLEST = 1e-32
"""Below this Radiance stores black."""
_EXPONENT_BIAS = 128
_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Of the plane's most even additive sequence (Roberts 2018, R2): neighbours get thresholds far from each other."""
_MIN_RUN, _MAX_RUN, _MAX_LITERAL = 4, 127, 128
RLE_WIDTHS = range(8, 32768)


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
    """Return rows of pixels in the new run-length code, or flat where their width has no such code."""
    width = rgbe.shape[1]
    if width not in RLE_WIDTHS:
        return rgbe.tobytes()
    mark = bytes((2, 2, width >> 8, width & 255))
    planes = np.ascontiguousarray(rgbe.transpose(0, 2, 1))
    return b"".join(mark + b"".join(_encode_line(line) for line in row) for row in planes)


def _encode_line(line: Bytes) -> bytes:
    """Return one component of one row: runs of at least four, the rest as it is."""
    changes = np.flatnonzero(line[1:] != line[:-1]) + 1
    starts = np.concatenate(([0], changes))
    lengths = np.diff(np.concatenate((starts, [line.size])))
    long = lengths >= _MIN_RUN
    out, done, data = bytearray(), 0, line.tobytes()
    for start, length in zip(starts[long].tolist(), lengths[long].tolist(), strict=True):
        _literals(out, data[done:start])
        done = start + length
        for _ in range(length // _MAX_RUN):
            out += bytes((128 + _MAX_RUN, data[start]))
        if length % _MAX_RUN:
            out += bytes((128 + length % _MAX_RUN, data[start]))
    _literals(out, data[done:])
    return bytes(out)


def _literals(out: bytearray, data: bytes) -> None:
    for start in range(0, len(data), _MAX_LITERAL):
        piece = data[start : start + _MAX_LITERAL]
        out.append(len(piece))
        out += piece


def decode_rows(data: bytes, width: int, height: int) -> Bytes:
    """Return (H, W, 4) bytes of pixel data, run-length coded or flat.

    Raises `RunLengthError` for data that end early, go on, overrun a row, or use the run-length code of before 1991.
    """
    if width not in RLE_WIDTHS or data[:2] != b"\2\2" or data[2:3] >= b"\x80":
        return _flat(data, width, height)
    out = np.empty((height, 4, width), dtype=np.uint8)
    mark, place = bytes((2, 2, width >> 8, width & 255)), 0
    for row in out:
        if data[place : place + 4] != mark:
            raise RunLengthError("a row does not begin as rows begin")
        place += 4
        for component in row:
            line, place = _decode_line(data, place, width)
            component[:] = np.frombuffer(line, dtype=np.uint8)
    if place != len(data):
        raise RunLengthError(f"{len(data) - place} bytes follow the last row")
    return np.ascontiguousarray(out.transpose(0, 2, 1))


def _flat(data: bytes, width: int, height: int) -> Bytes:
    if len(data) != 4 * width * height:
        raise RunLengthError(f"{len(data)} bytes are not {width} x {height} pixels")
    out = np.frombuffer(data, dtype=np.uint8).reshape(height, width, 4)
    if bool((out[..., :3] == 1).all(axis=2).any()):
        raise RunLengthError("it uses the run-length code of before 1991, or is damaged")
    return out


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
