"""The work of rendering, as functions that a worker process can run: image bands, exposures, mosaics."""

from __future__ import annotations

from processing.ground.arrays import Floats

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image

from mocks.lenses import Size
from mocks.light import World
from mocks.optics import CameraOptics, image_rows
from mocks.sensor import Exposure

_BAND_PX = 400_000
_EXPOSE_ROWS = 32
_PIXEL_BYTES = 12


@dataclass(frozen=True)
class ImageJob:
    """A whole image to be rendered into a file.

    The file holds a plane for each component of the world's light, rows of float32 RGB; then the mean image of each
    (3 float32).
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


def render_band(job: ImageJob, rows: range) -> tuple[Floats, float]:
    """Render a band into its places in the file; return each plane's light (sum over solid angle) and solid angle."""
    width, height = job.size
    x = np.arange(width, dtype=np.float32) + np.float32(0.5)
    y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] + np.float32(0.5)
    weight = job.optics.lens.solid_angle_sr(x, y, job.size)
    totals = []
    with job.path.open("r+b") as file:
        for plane in range(len(job.world.components)):
            light = image_rows(job.world, job.optics, job.size, rows, plane)
            file.seek((plane * height + rows.start) * width * _PIXEL_BYTES)
            file.write(light.data)
            totals.append(np.einsum("ijk,ij->k", light, weight, dtype=np.float64))
    return np.array(totals, dtype=np.float32), float(weight.sum(dtype=np.float64))


def finish_image(job: ImageJob, parts: list[tuple[Floats, float]]) -> None:
    """Append the mean image of each plane over the field to the file."""
    mean = sum(np.asarray(light, np.float64) for light, _ in parts) / sum(weight for _, weight in parts)
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


def mosaic(job: PictureJob, step: int) -> npt.NDArray[np.uint16]:
    """Return a small Bayer mosaic (RGGB) of the exposure, every ``step``-th pixel, in raw counts."""
    width, height = job.size
    rng = np.random.default_rng([job.seed, 1 << 32])
    file = _ImageFile(job)
    rows = np.concatenate([file.light(range(row, row + 1))[:, ::step] for row in range(0, height, step)])
    light = rows[: height // step // 2 * 2, : width // step // 2 * 2]
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
        self._veil = np.float32(job.optics.glare) * (np.array(job.weights, np.float32) @ means.reshape(-1, 3))

    def light(self, rows: range) -> Floats:
        """Return rows of light (len(rows), width, 3)."""
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
