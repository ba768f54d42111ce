"""The work of rendering, as functions that a worker process can run: image bands, exposures, mosaics."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from mocks.lenses import Size
from mocks.light import Floats, World
from mocks.optics import CameraOptics, image_rows
from mocks.sensor import Exposure

_BAND_PX = 400_000
_EXPOSE_ROWS = 32


@dataclass(frozen=True)
class ImageJob:
    """A whole image to be rendered into a file: rows of float32 RGB, then the mean image (3 float32)."""

    world: World
    optics: CameraOptics
    size: Size
    path: Path


@dataclass(frozen=True)
class PictureJob:
    """One exposure of a rendered image; ``light`` is the world's light factor at that time."""

    optics: CameraOptics
    size: Size
    image: Path
    exposure: Exposure
    light: float
    seed: int


def bands(size: Size) -> list[range]:
    """Return the bands of rows that an image is rendered in: small, so that memory stays small."""
    step = max(4, _BAND_PX // size[0])
    return [range(first, min(first + step, size[1])) for first in range(0, size[1], step)]


def render_band(job: ImageJob, rows: range) -> tuple[Floats, float]:
    """Render a band into its place in the file; return its light (sum over solid angle) and solid angle."""
    light = image_rows(job.world, job.optics, job.size, rows)
    with job.path.open("r+b") as file:
        file.seek(rows.start * job.size[0] * 12)
        file.write(light.data)
    x = np.arange(job.size[0], dtype=np.float32) + np.float32(0.5)
    y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] + np.float32(0.5)
    weight = job.optics.lens.solid_angle_sr(x, y, job.size)
    total = np.einsum("ijk,ij->k", light, weight, dtype=np.float64).astype(np.float32)
    return total, float(weight.sum(dtype=np.float64))


def finish_image(job: ImageJob, parts: list[tuple[Floats, float]]) -> None:
    """Append the mean image over the field to the file."""
    mean = sum(np.asarray(light, np.float64) for light, _ in parts) / sum(weight for _, weight in parts)
    with job.path.open("r+b") as file:
        file.seek(job.size[0] * job.size[1] * 12)
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


def mosaic(job: PictureJob, step: int) -> npt.NDArray[np.uint16]:
    """Return a small Bayer mosaic (RGGB) of the exposure, every ``step``-th pixel, in raw counts."""
    width, height = job.size
    rng = np.random.default_rng([job.seed, 1 << 32])
    image = np.memmap(job.image, np.float32, "r", shape=(height, width, 3))
    light = np.array(image[::step, ::step][: height // step // 2 * 2, : width // step // 2 * 2])
    signal = job.optics.sensor.mosaic_signal(_lit(job, light), job.exposure, rng)
    bayer = signal[..., 1].copy()
    bayer[::2, ::2] = signal[::2, ::2, 0]
    bayer[1::2, 1::2] = signal[1::2, 1::2, 2]
    sensor = job.optics.sensor
    white = 2**sensor.raw_bits - 1
    counts = sensor.raw_black + bayer * (white - sensor.raw_black)
    return np.asarray(np.clip(np.rint(counts), 0, white), dtype=np.uint16)


def _signals(job: PictureJob) -> Iterator[tuple[range, Floats]]:
    """Yield the sensor's signal, a few rows at a time; each has its own random numbers."""
    width, height = job.size
    with job.image.open("rb") as file:
        file.seek(width * height * 12)
        veil = np.fromfile(file, np.float32, 3)
        file.seek(0)
        for first in range(0, height, _EXPOSE_ROWS):
            rows = range(first, min(first + _EXPOSE_ROWS, height))
            light = np.fromfile(file, np.float32, len(rows) * width * 3).reshape(len(rows), width, 3)
            rng = np.random.Generator(np.random.SFC64([job.seed, first]))
            light = _veiled(light, veil, job.optics.glare)
            yield rows, job.optics.sensor.mosaic_signal(_lit(job, light), job.exposure, rng)


def _veiled(light: Floats, veil: Floats, glare: float) -> Floats:
    if glare == 0:
        return light
    light *= np.float32(1 - glare)
    light += np.float32(glare) * veil
    return light


def _lit(job: PictureJob, light: Floats) -> Floats:
    return light if job.light == 1.0 else light * np.float32(job.light)
