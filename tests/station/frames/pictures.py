"""Small JPEGs of one scene at many exposure times, with EXIF; written by Pillow, which the station does not use."""

from __future__ import annotations

import io
from datetime import datetime
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

SIZE = (160, 120)
TAKEN = datetime(2023, 5, 19, 15, 54, 10)
MAKE, MODEL, DATE, ORIENTATION = 0x010F, 0x0110, 0x0132, 0x0112
EXPOSURE, F_NUMBER, ISO, TAKEN_TAG, OFFSET, WIDTH, HEIGHT, SERIAL = (
    0x829A,
    0x829D,
    0x8827,
    0x9003,
    0x9011,
    0xA002,
    0xA003,
    0xA431,
)


@lru_cache
def scene(seed: int = 1, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Return relative light, 0.02 to 50 with grain, of a made-up room."""
    rng = np.random.default_rng(seed)
    width, height = size
    ramp = np.logspace(-1.7, 1.5, width)[None, :] * np.linspace(0.7, 1.3, height)[:, None]
    grain = rng.lognormal(0, 0.25, (height, width))
    tint = np.array([1.0, 0.9, 0.7])
    return (ramp * grain)[..., None] * tint


def pixels(time_s: float, seed: int = 1, size: tuple[int, int] = SIZE) -> np.ndarray:
    """Return the scene's 8-bit picture at an exposure time (display gamma, clipped)."""
    return np.round(255 * np.clip(scene(seed, size) * time_s, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def ratio(value: float) -> IFDRational:
    """Return a value as EXIF holds it; Pillow alone would write a double, which no camera does."""
    fraction = Fraction(value).limit_denominator(1_000_000)
    return IFDRational(fraction.numerator, fraction.denominator)


def exif(time_s: float, size: tuple[int, int] = SIZE, **changes: Any) -> Image.Exif:
    """Return EXIF as a camera writes it; ``changes`` by tag name replace or (None) remove values."""
    block = Image.Exif()
    block[MAKE], block[MODEL] = "Canon", "Canon EOS 5D Mark II"
    sub = block.get_ifd(0x8769)
    sub.update(
        {
            EXPOSURE: ratio(time_s),
            F_NUMBER: IFDRational(56, 10),
            ISO: 100,
            WIDTH: size[0],
            HEIGHT: size[1],
        }
    )
    sub[TAKEN_TAG] = f"{TAKEN:%Y:%m:%d %H:%M:%S}"
    sub[SERIAL] = "0123456789"
    for name, value in changes.items():
        tag = globals()[name]
        where = block if tag in (MAKE, MODEL, DATE, ORIENTATION) else sub
        if value is None:
            del where[tag]
        else:
            where[tag] = ratio(value) if isinstance(value, float) else value
    return block


def jpeg(
    time_s: float = 0.25,
    *,
    seed: int = 1,
    size: tuple[int, int] = SIZE,
    picture: np.ndarray | None = None,
    with_exif: bool = True,
    said_s: float | None = None,
    **options: Any,
) -> bytes:
    """Return a JPEG file; upper-case ``options`` change EXIF, the others go to Pillow's writer."""
    changes = {name: options.pop(name) for name in list(options) if name.isupper()}
    picture = pixels(time_s, seed, size) if picture is None else picture
    buffer = io.BytesIO()
    if with_exif:
        height, width = picture.shape[:2]
        options["exif"] = exif(said_s or time_s, (width, height), **changes)
    Image.fromarray(picture).save(buffer, "JPEG", **{"quality": 90, **options})
    return buffer.getvalue()


def dng(time_s: float, **changes: Any) -> bytes:
    """Return a DNG of 193,000 bytes with EXIF and one strip of nothing."""
    block = exif(time_s, **{"MAKE": "RICOH", "MODEL": "RICOH THETA Z1", **changes})
    block[273], block[279], block[0xC612] = 2_000, 190_000, b"\1\4\0\0"
    return block.tobytes().removeprefix(b"Exif\0\0").ljust(2_000, b"\0") + b"x" * 191_000


def cr2() -> bytes:
    """Return a file with the structure of a CR2, one strip of nothing and no EXIF."""
    entries = [(273, 1000), (279, 190_000)]
    table = len(entries).to_bytes(2, "little")
    for tag, value in entries:
        table += tag.to_bytes(2, "little") + b"\4\0\1\0\0\0" + value.to_bytes(4, "little")
    head = b"II*\0" + (16).to_bytes(4, "little") + b"CR\x02\0" + b"\0" * 4
    return (head + table + bytes(4)).ljust(1000, b"\0") + b"x" * 190_000
