"""Pictures for the simulated cameras: rendered before the capture, kept on disk, served in milliseconds.

Rendering runs in worker processes, in bands of rows, so that the station stays small; at the moment of exposure
only the EXIF segments are put into finished JPEG bytes.
"""

import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np

from mocks.instruments.exposures import ShotRequest
from mocks.optics import picture_jobs
from mocks.optics.camera import CameraOptics
from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye, Size
from mocks.optics.picture_cache import PictureCache, content_key
from mocks.optics.sensor import Exposure
from mocks.worlds.light import World, mean_weights

# Raise when rendering changes, so that old pictures are not served.
_RENDER_VERSION = 8
# Below this many pixels a worker process costs more than it saves.
_POOL_FROM_PX = 3_000_000
_RAW_WIDTH_PX = 702  # chosen: raw files small enough for a test
_THETA_FOCAL_MM = 2.6  # EXIF of the Theta Z1

# `map`, or the same over worker processes.
_Map: TypeAlias = Callable[..., Iterable[Any]]


@dataclass(frozen=True)
class _Shot:
    """One picture that is wanted: its exposure, and how bright each component of the light is meanwhile."""

    exposure: Exposure
    weights: tuple[float, ...]
    number: int = field(default=0, repr=False)
    """Of the exposures alike, from 0: its noise."""


class RenderedShots:
    """The pictures of one simulated camera (a `mocks.instruments.exposures.ShotSource`).

    ``world``, ``optics``: what is looked at, and through what.
    ``seed``: of the noise; every stop has noise of its own, and with ``fresh`` every exposure of one too (rendered when
    it is asked for): else a stop that is taken again is the same picture.
    ``cache``: where pictures are kept; by default the user's cache folder, 2 GB at most.
    ``workers``: processes that render, 0 to render in this one.
    ``on_progress``: called with steps done and steps in all while rendering (some seconds for a full-size image).
    """

    def __init__(
        self,
        world: World,
        optics: CameraOptics,
        *,
        seed: int = 0,
        fresh: bool = False,
        cache: PictureCache | None = None,
        workers: int = 2,
        on_progress: Callable[[int, int], None] | None = None,
    ) -> None:
        self.world = world
        self.optics = optics
        self.seed = seed
        self.fresh = fresh
        self._served: Counter[Exposure] = Counter()
        self.cache = cache or PictureCache()
        self.workers = workers
        self._on_progress = on_progress
        self._world_key = world.key
        self._times_s: dict[float, float] = {}

    def prepare(
        self,
        shutters_s: Sequence[float],
        width: int,
        height: int,
        *,
        settings: Exposure | None = None,
        times_s: Sequence[float] | None = None,
        raw: bool = False,
    ) -> int:
        """Render what is not in the cache yet; return how many pictures were rendered.

        ``settings`` are the camera's other settings (its ``shutter_s`` is not used; by default the paper's);
        ``times_s`` are the world times at which the stops begin (0 by default), if the light varies; ``raw``
        prepares raw frames too.
        """
        usual = settings or self.optics.usual_settings
        if times_s is not None:
            pairs = zip(shutters_s, times_s, strict=True)
            self._times_s.update({_rounded(shutter): time for shutter, time in pairs})
        exposures = [replace(usual, shutter_s=_rounded(shutter)) for shutter in shutters_s]
        return self._render([self._shot(exposure) for exposure in exposures], (width, height), raw=raw)

    def jpeg(self, request: ShotRequest) -> bytes:
        """Return the JPEG of an exposure; one that was not prepared is rendered now, which takes seconds."""
        shot, size = self._shot_of(request), (request.width_px, request.height_px)
        if self.fresh:
            shot = replace(shot, number=self._served[shot.exposure])
            self._served[shot.exposure] += 1
        key = self._key(shot, size)
        data = self.cache.read(key, ".jpg")
        if data is None or not picture_jobs.is_whole_jpeg(data):
            if data is not None:
                self.cache.path(key, ".jpg").unlink(missing_ok=True)
            self._render([shot], size, raw=False)
            data = self.cache.path(key, ".jpg").read_bytes()
        lens = self.optics.lens
        focal_mm = lens.focal_length_mm if isinstance(lens, EquisolidFisheye) else _THETA_FOCAL_MM
        segments = [picture_jobs.exif_segment(request, focal_mm)]
        if isinstance(lens, EquirectangularLens):
            segments.append(picture_jobs.gpano_segment(*size))
        return picture_jobs.splice(data, segments)

    def raw(self, request: ShotRequest) -> bytes:
        """Return a small but real raw file of an exposure: CR2 from a Canon, DNG otherwise."""
        shot, size = self._shot_of(request), (request.width_px, request.height_px)
        key = self._key(shot, size)
        data = self.cache.read(key, ".mosaic")
        if data is None:
            self._render([shot], size, raw=True)
            data = self.cache.path(key, ".mosaic").read_bytes()
        sensor = self.optics.sensor
        counts = np.frombuffer(data, dtype=np.uint16).reshape(size[1] // _raw_step(size) // 2 * 2, -1)
        red, green, blue = sensor.native_balance
        own = ((red, 0.0, 0.0), (0.0, green, 0.0), (0.0, 0.0, blue))
        frame = picture_jobs.RawFrame(counts, sensor.raw_black, 2**sensor.raw_bits - 1, own)
        return picture_jobs.mosaic_file(frame, request, cr2=request.manufacturer.startswith("Canon"))

    def _shot_of(self, request: ShotRequest) -> _Shot:
        shutter_s = _rounded(request.shutter_s)
        return self._shot(Exposure(shutter_s, request.iso, request.f_number, request.color_temperature_k))

    def _shot(self, exposure: Exposure) -> _Shot:
        start_s = self._times_s.get(exposure.shutter_s, 0.0)
        open_s = self.optics.sensor.true_shutter.seconds(exposure.shutter_s)
        return _Shot(exposure, mean_weights(self.world, start_s, open_s))

    def _key(self, shot: _Shot, size: Size) -> str:
        seed = (self.seed, shot.number) if shot.number else self.seed
        return content_key(_RENDER_VERSION, self._world_key, self.optics.key, size, shot, seed)

    def _render(self, shots: list[_Shot], size: Size, *, raw: bool) -> int:
        """Render the shots that the cache lacks."""
        seen = (self.optics.site, self.optics.lens, self.optics.filter, self.optics.samples_per_side(size))
        image_key = content_key(_RENDER_VERSION, self._world_key, *seen, size)
        if not self._missing(shots, size, ".jpg") and not (raw and self._missing(shots, size, ".mosaic")):
            return 0
        with self.cache.rendering():
            missing = self._missing(shots, size, ".jpg")
            raw_missing = self._missing(shots, size, ".mosaic") if raw else []
            if not missing and not raw_missing:
                return 0
            image = self.cache.path(image_key, ".image")
            with self._mapper(size) as run:
                image_steps = 0 if self.cache.holds(image_key, ".image") else len(picture_jobs.bands(size))
                steps = _Steps(image_steps + len(missing), self._on_progress)
                if image_steps:
                    with self.cache.new_file(image_key, ".image") as path:
                        job = picture_jobs.ImageJob(self.world, self.optics, size, path)
                        bands = run(partial(picture_jobs.render_band, job), picture_jobs.bands(size))
                        picture_jobs.finish_image(job, list(steps.counted(bands)))
                tasks = [(self._job(shot, size, image), self._key(shot, size)) for shot in missing]
                list(steps.counted(run(partial(_expose, self.cache), tasks)))
            for shot in raw_missing:
                counts = picture_jobs.mosaic(self._job(shot, size, image), _raw_step(size))
                self.cache.write(self._key(shot, size), ".mosaic", counts.tobytes())
        return len(missing)

    def _missing(self, shots: list[_Shot], size: Size, suffix: str) -> list[_Shot]:
        return [shot for shot in shots if not self.cache.holds(self._key(shot, size), suffix)]

    def _job(self, shot: _Shot, size: Size, image: Path) -> picture_jobs.PictureJob:
        seed = int(self._key(shot, size)[:15], 16)
        return picture_jobs.PictureJob(self.optics, size, image, shot.exposure, shot.weights, seed)

    @contextmanager
    def _mapper(self, size: Size) -> Iterator[_Map]:
        """Give a map function: over worker processes where the work is large, else the built-in one."""
        if self.workers < 1 or size[0] * size[1] < _POOL_FROM_PX:
            yield map
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(
            self.workers, mp_context=context, initializer=cv2.setNumThreads, initargs=(1,)
        ) as pool:
            yield pool.map


class _Steps:
    """Counts finished work and calls the listener."""

    def __init__(self, total: int, listener: Callable[[int, int], None] | None) -> None:
        self._done, self._total, self._listener = 0, total, listener

    def counted(self, results: Iterable[Any]) -> Iterator[Any]:
        for result in results:
            self._done += 1
            if self._listener:
                self._listener(self._done, self._total)
            yield result


def _expose(cache: PictureCache, task: tuple[picture_jobs.PictureJob, str]) -> None:
    """Expose one picture and store it under its key, in a worker process too."""
    job, key = task
    cache.holds(job.image.stem, job.image.suffix)  # marks it as in use
    cache.write(key, ".jpg", picture_jobs.expose(job))


def _rounded(shutter_s: float) -> float:
    """Return the time to six digits: a camera may say 0.016667 for 1/60."""
    return float(f"{shutter_s:.6g}")


def _raw_step(size: Size) -> int:
    return max(1, round(size[0] / _RAW_WIDTH_PX))
