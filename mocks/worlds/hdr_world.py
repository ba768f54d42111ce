"""A world of HDR pictures, one equirectangular picture for the room and one for the sky, and how they are sampled."""

from __future__ import annotations

import hashlib
import math
import os
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from mocks.worlds.light import LightDrift, OneLight, Site, WorldFileError
from processing.ground.arrays import Floats, Reals

MAX_PIXELS = 16384 * 8192
_UNDERSHOOT = 0.05  # chosen: resampled panoramas ring a little below zero
_REMAP_WIDTH = 8192  # below OpenCV's limit of 32767
_HDR_MAGIC = (b"#?RADIANCE", b"#?RGBE")
_EXR_MAGIC = b"\x76\x2f\x31\x01"


@dataclass(frozen=True)
class HdrWorld(OneLight):
    """Radiance from two equirectangular HDR pictures (.hdr or .exr), twice as wide as high.

    The centre column looks along y (ahead), the first row up. ``scale`` turns the indoor picture's values into
    cd/m2, ``outdoor_scale`` the outdoor picture's. The sun, where there is one, is part of the picture.
    """

    indoor: Path
    outdoor: Path
    scale: float = 100.0
    outdoor_scale: float = 5000.0
    drift: LightDrift = field(default_factory=LightDrift)

    @property
    def key(self) -> str:
        """Return digests of both files and the scales."""
        digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in (self.indoor, self.outdoor)]
        return f"HdrWorld {digests} {self.scale!r} {self.outdoor_scale!r}"

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return the picture's radiance, shape (..., 3), bilinear, averaged over ``pixel_rad`` where coarser."""
        path, scale = (self.indoor, self.scale) if site is Site.INDOOR else (self.outdoor, self.outdoor_scale)
        texture = _texture_of(path, path.stat().st_mtime_ns, scale)
        height, width = texture.shape
        longitude = np.arctan2(directions[..., 0], directions[..., 1])
        latitude = np.arcsin(np.clip(directions[..., 2], -1, 1))
        column = (longitude / (2 * math.pi) + 0.5) * width - 0.5
        row = (0.5 - latitude / math.pi) * height - 0.5
        # The level whose pixels are just not coarser than what is averaged over
        level = math.floor(math.log2(max(pixel_rad * height / math.pi, 1.0)))
        return texture.sample(column, row, min(level, len(texture.levels) - 1))


@lru_cache(maxsize=2)
def _texture_of(path: Path, _changed_ns: int, scale: float) -> MipTexture:
    pixels = read_equirect(path)
    pixels *= np.float32(scale)
    return MipTexture.equirectangular(pixels)


def read_equirect(path: Path) -> Floats:
    """Read an equirectangular picture as RGB float32 (H, W, 3).

    Raises `WorldFileError` unless it is a .hdr or .exr file, twice as wide as high, finite and non-negative (but
    for undershoots of lossy compression, up to 5 % of the median, which become 0).
    """
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise _refused(path, f"cannot be read ({error.strerror})") from error
    if head.startswith(_HDR_MAGIC):
        _, _, rest = head.partition(b"\n\n")
        words = rest.split(b"\n", 1)[0].split()
        if len(words) != 4 or words[0] != b"-Y" or words[2] != b"+X":
            raise _refused(path, "has no resolution line '-Y height +X width'")
        if not (words[1].isdigit() and words[3].isdigit()):
            raise _refused(path, "has a resolution that is not a number")
        _check_size(path, int(words[3]), int(words[1]))
        pixels = cv2.imdecode(np.fromfile(path, dtype=np.uint8), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
        if pixels is None or pixels.dtype != np.float32:
            raise _refused(path, "cannot be decoded: damaged or cut short")
        pixels = np.ascontiguousarray(pixels[..., ::-1])
    elif head.startswith(_EXR_MAGIC):
        pixels = _read_exr(path)
    else:
        raise _refused(path, "is neither Radiance HDR nor OpenEXR")
    if not np.isfinite(pixels).all():
        raise _refused(path, "holds values that are not finite")
    # Lossy EXR compression undershoots a little; real negative light is a fault.
    if pixels.min() < -_UNDERSHOOT * float(np.median(pixels)):
        raise _refused(path, "holds negative light")
    return np.maximum(pixels, 0, out=pixels)


def _read_exr(path: Path) -> Floats:
    import OpenEXR

    try:
        with OpenEXR.File(os.fspath(path), header_only=True) as header:
            low, high = header.header()["dataWindow"]
        width, height = int(high[0] - low[0] + 1), int(high[1] - low[1] + 1)
        _check_size(path, width, height)
        with OpenEXR.File(os.fspath(path)) as picture:
            channels = picture.channels()
            channel = channels.get("RGB") or channels.get("RGBA")
            if channel is None:
                raise _refused(path, "has no R, G and B channels")
            return np.ascontiguousarray(channel.pixels[..., :3], dtype=np.float32)
    except (RuntimeError, ValueError, TypeError) as error:
        raise _refused(path, f"cannot be decoded ({error})") from error


def _check_size(path: Path, width: int, height: int) -> None:
    if width != 2 * height or height < 4:
        raise _refused(path, f"is {width}x{height}; an equirectangular picture is twice as wide as high")
    if width * height > MAX_PIXELS:
        raise _refused(path, f"has {width * height} pixels, more than {MAX_PIXELS}")


def _refused(path: Path, what: str) -> WorldFileError:
    likely = "not an equirectangular HDR picture, or a damaged download"
    advice = "give a .hdr or .exr panorama, twice as wide as high"
    return WorldFileError(f"{path.name} {what}", where="world", likely=likely, advice=advice)


@dataclass(frozen=True)
class MipTexture:
    """A picture and its halvings; every level carries a border of one pixel, so that lookups never leave it."""

    levels: tuple[Floats, ...]

    @classmethod
    def equirectangular(cls, pixels: Floats) -> MipTexture:
        """Return the texture of a panorama (H, W, 3): the columns wrap, and over a pole lies the other half."""
        return cls(tuple(_sphere_border(level) for level in _halvings(pixels)))

    @classmethod
    def tiled(cls, pixels: Floats) -> MipTexture:
        """Return the texture of a tile (H, W, 3) that repeats in both directions."""
        return cls(tuple(np.pad(level, ((1, 1), (1, 1), (0, 0)), mode="wrap") for level in _halvings(pixels)))

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the finest level."""
        return self.levels[0].shape[0] - 2, self.levels[0].shape[1] - 2

    def sample(self, column: Reals, row: Reals, level: int = 0) -> Floats:
        """Return bilinear values at finest-level coordinates of any shape (0 is the centre of the first pixel).

        Coordinates must lie within half a pixel of the picture; tiles are wrapped by the caller.
        """
        image = self.levels[level]
        scale = 0.5**level
        x = np.asarray((column + 0.5) * scale + 0.5, dtype=np.float32)
        y = np.asarray((row + 0.5) * scale + 0.5, dtype=np.float32)
        return _remap(image, x, y) if x.ndim == 2 and max(x.shape) < 32767 else remapped(image, x, y)


def remapped(image: Floats, x: Floats, y: Floats) -> Floats:
    """Return a picture (H, W, 3) between its pixels at x, y (pixels, whole at centres), of shape (..., 3) by theirs."""
    return _remap(image, _blocks(x), _blocks(y)).reshape(-1, 3)[: x.size].reshape(*x.shape, 3)


def _remap(image: Floats, x: Floats, y: Floats) -> Floats:
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)


def _blocks(values: Floats) -> Floats:
    rows = max(1, -(-values.size // _REMAP_WIDTH))
    block = np.zeros(rows * _REMAP_WIDTH, dtype=np.float32)
    block[: values.size] = values.ravel()
    return block.reshape(rows, _REMAP_WIDTH)


def _halvings(pixels: Floats) -> list[Floats]:
    levels = [pixels]
    while min(levels[-1].shape[:2]) >= 8 and all(n % 2 == 0 for n in levels[-1].shape[:2]):
        last = levels[-1]
        levels.append(0.25 * (last[::2, ::2] + last[1::2, ::2] + last[::2, 1::2] + last[1::2, 1::2]))
    return levels


def _sphere_border(pixels: Floats) -> Floats:
    half = pixels.shape[1] // 2
    tall = np.concatenate([np.roll(pixels[:1], half, 1), pixels, np.roll(pixels[-1:], half, 1)])
    return np.ascontiguousarray(np.concatenate([tall[:, -1:], tall, tall[:, :1]], axis=1))
