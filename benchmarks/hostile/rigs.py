"""A rig of two hostile cameras, calibrated by the product's own rig calibration, its room and sky beside their truth.

What `benchmarks.photometry` measures with the simulated cameras, by the same code, with others in their place. Each
draw is another rig: both cameras with a published curve, mosaic, maker's processing, a worn sensor, an encoder, and in
half of the draws tone mapping; shutters that are off; lenses that scatter and mirror, the panorama's second one of
another brightness; a density filter with a tint. Each lens is a copy: fall-off that is no polynomial, and the
fisheye's mapping, axis and circle off what is supposed of it. Rooms and skies are the simulated rig's, and stand still:
clouds and flicker are in `hostile`, spectra in `spectra`.
"""

from __future__ import annotations

import math
import tempfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.hostile.worlds import (
    ENCODERS,
    LENS_BLUR_PX,
    MATRIX_5D2,
    WORN,
    Curves,
    HostileCamera,
    HostileWorld,
    jpeg_file,
    through_lens,
)
from benchmarks.kept_rows import Row, fresh
from benchmarks.photometry.rig import calibrated_rig, measured, measured_again, with_own_lens
from benchmarks.sessions import BODIES, Body, Taken
from mocks.instruments.exposures import ShotRequest
from mocks.optics.camera import ND3_TINT, CameraOptics, Filter, scene_rows
from mocks.optics.lenses import EquirectangularLens, EquisolidFisheye, Lens, Size
from mocks.optics.sensor import Exposure, TrueShutter
from mocks.worlds.light import Vector, World
from mocks.worlds.simple_room import SimpleRoom
from processing.errors import ProcessingError
from processing.ground.arrays import Doubles, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.images import luminance_cd_m2
from station.session.session import Side
from training.response_prior import log2_exposure

ROOM_GAIN = 0.6
"""As in `photometry`: the shortest frame just holds the sun."""
SPOT_RAD = math.radians(1.0)  # the meter's field
FULL_LEAK_S = 4.0
"""Chosen: beyond it makers subtract a dark frame."""
SLACK_RAD = 0.02  # of a fisheye's field beyond its circle, so that the axis may be off the circle's middle


@dataclass(frozen=True)
class FisheyeCopy(EquisolidFisheye):
    """A copy of the fisheye: its image height is bent, its axis off the middle of a circle that is off the frame's."""

    half_field_rad: float = math.pi / 2 + SLACK_RAD
    bend: float = 0.0
    """Image height over an equisolid one: 1 + bend theta2, over the same at the circle's edge."""
    circle: tuple[float, float] = (0.0, 0.0)
    axis: tuple[float, float] = (0.0, 0.0)
    """Right and up of the middle, in radii."""

    def pixel_of(self, direction: Vector, size: Size) -> tuple[float, float] | None:
        """Return the picture point, None outside the field."""
        found = super().pixel_of(direction, size)
        if found is None:
            return None
        stretch = float(self._stretch(math.acos(max(-1.0, min(1.0, direction[2])))))
        right, up = self._off(size)
        x, y = (found[0] - size[0] / 2) * stretch, (found[1] - size[1] / 2) * stretch
        return size[0] / 2 + right + x, size[1] / 2 - up + y

    def rows_near(self, direction: Vector, angle_rad: float, size: Size) -> range:
        """Return the rows around the direction's picture."""
        place = self.pixel_of(direction, size)
        reach = math.ceil(2 * angle_rad * self._focal_px(size) + 2)
        return range(0) if place is None else range(max(0, int(place[1]) - reach), min(size[1], int(place[1]) + reach))

    def solid_angle_sr(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return the solid angle (broadcast shape) of pixels, from how far apart their corners look."""
        plane = [self._plane(x + dx, y + dy, size)[:2] for dx, dy in ((0.5, 0), (-0.5, 0), (0, 0.5), (0, -0.5))]
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = plane
        area = np.abs((ax - bx) * (cy - dy) - (cx - dx) * (ay - by)) / self._focal_px(size) ** 2
        return np.asarray(area * (self.falloff(x, y, size) > 0), dtype=np.float32)

    def falloff(self, x: Floats, y: Floats, size: Size) -> Floats:
        """Return the fall-off (broadcast shape, 0..1), 0 outside the circle."""
        right, up = (frac * self._radius_px(size) for frac in self.circle)
        from_middle = np.hypot(x - size[0] / 2 - right, y - size[1] / 2 + up)
        return np.where(from_middle <= self._radius_px(size), super().falloff(x, y, size), 0).astype(np.float32)

    def _radius_px(self, size: Size) -> float:
        return 2 * self._focal_px(size) * math.sin(math.pi / 4)

    def _off(self, size: Size) -> tuple[float, float]:
        right, up = ((a + b) * self._radius_px(size) for a, b in zip(self.circle, self.axis, strict=True))
        return right, up

    def _stretch(self, theta_rad: Doubles | float) -> Doubles:
        return np.asarray((1 + self.bend * np.square(theta_rad)) / (1 + self.bend * (math.pi / 2) ** 2))

    def _plane(self, x: Floats, y: Floats, size: Size) -> tuple[Doubles, Doubles, Doubles]:
        """Return where an equisolid lens would draw what this one draws at these points."""
        right, up, _ = super()._plane(x, y, size)
        off = self._off(size)
        right, up = right - off[0], up - off[1]
        angles = np.linspace(0, 2.5, 2000)
        even = 2 * self._focal_px(size) * np.sin(angles / 2)
        drawn = even * self._stretch(angles)
        far = np.hypot(right, up)
        scale = np.interp(far, drawn, even) / np.maximum(far, 1e-9)
        right, up = right * scale, up * scale
        return right, up, right * right + up * up


@dataclass(frozen=True)
class HostileBody(Body):
    """A hostile camera in a session; what is wrong with shutter and lens is its world's."""

    known: bool = field(default=False, init=False)
    world: HostileWorld = field(kw_only=True)

    def pictures(self, taken: Taken, side: Side) -> Callable[[ShotRequest], bytes]:
        """Return what gives the JPEG of each exposure of a session."""
        optics, size, camera = taken.optics(side), taken.size_px(side), self.world.camera
        light = optics.filter.apply(_scene(taken.world, self.optics, size)) * self._kept(size)
        shown, coding = through_lens(light, self.world), camera.jpeg
        assert coding is not None
        first = zlib.crc32(repr((taken.world.key, taken.nd, taken.seed)).encode()) // 100 * 100

        def picture(request: ShotRequest) -> bytes:
            number = first + request.sequence
            off = self.world.jitter_stops * np.random.default_rng((camera.seed, 8, number)).standard_normal()
            gain = optics.sensor.exposure_gain(Exposure(request.shutter_s, request.iso, request.f_number))
            leak = min(1.0, request.shutter_s / FULL_LEAK_S)
            return jpeg_file(camera.developed(shown * np.float32(gain * 2**off), number, leak), coding)

        return picture

    def log2_exposure(self) -> Doubles:
        """Return the true curve (3, 256) of the tone table, whatever tone mapping adds."""
        camera = self.world.camera
        return np.stack([log2_exposure(camera.irradiance, shown) for shown in camera.brightness])

    def truth(self, taken: Taken, side: Side, bands: Sequence[range]) -> Floats:
        """Return the radiance (h, W, 3) that pixels truly average; no lens draws sharper (`LENS_BLUR_PX`)."""
        rows = np.concatenate([np.array(band) for band in bands])
        return np.asarray(_scene(taken.world, self.optics, taken.size_px(side))[rows])

    def shown_share(self, taken: Taken, target_cd_m2: float, mean_cd_m2: float) -> float:
        """Return what the lens shows of the meter's target over what it has: halo, ghost and second lens."""
        del target_cd_m2, mean_cd_m2
        size = taken.size_px(Side.INDOOR)
        ways, _ = self.optics.lens.directions(*_middles(size), size)
        spot = ways @ np.array(taken.world.board_direction, np.float32) > math.cos(SPOT_RAD)  # type: ignore[attr-defined]
        light = _scene(taken.world, self.optics, size) * self._kept(size)
        shown, there = (luminance_cd_m2(one)[spot].mean() for one in (through_lens(light, self.world), light))
        return float(shown / there)

    def _kept(self, size: Size) -> Floats:
        return self.optics.lens.falloff(*_middles(size), size)[..., None]


def _middles(size: Size) -> tuple[Floats, Floats]:
    return np.arange(size[0], dtype=np.float32) + 0.5, np.arange(size[1], dtype=np.float32)[:, None] + 0.5


@lru_cache(maxsize=4)
def _scene(world: World, optics: CameraOptics, size: Size) -> Floats:
    light = scene_rows(world, optics, size, range(size[1]))
    return np.asarray(cv2.GaussianBlur(light, (0, 0), LENS_BLUR_PX), dtype=np.float32)


def hostile_bodies(curves: Curves, seed: int) -> dict[Side, Body]:
    """Return both cameras of a rig; a few numbers of its lenses are as those of `spectra`, the others chosen."""
    rng = np.random.default_rng((seed, 19))
    irradiance, every = curves
    bodies: dict[Side, Body] = {}
    for side, usual in BODIES.items():
        camera = HostileCamera(
            irradiance,
            every[int(rng.integers(len(every)))],
            full_well_e=float(rng.uniform(15e3, 60e3)),
            read_e=float(rng.uniform(2, 12)),
            matrix=MATRIX_5D2,
            mosaic=True,
            denoise=True,
            sharpen=float(rng.uniform(0.1, 0.5)),
            tone_mapping_stops=float(rng.choice((0.0, 0.1))),
            jpeg=ENCODERS[int(rng.integers(len(ENCODERS)))],
            seed=seed % 2**20 * 2 + int(side is Side.INDOOR),
            **WORN,  # type: ignore[arg-type]
        )
        inside = side is Side.INDOOR
        world = HostileWorld(
            side.value,
            camera,
            jitter_stops=float(rng.uniform(0, 0.05)),
            halo=float(rng.uniform(0, 0.02)),
            lenses=float(rng.normal(0, 0.02)) if inside else 0.0,
        )
        # A shutter's rule is the camera's; the panorama's is one or the other, and has to be found.
        rule = TrueShutter(rng.choice(list(TrueShutter))) if inside else TrueShutter.THIRDS_OF_STOPS
        sensor = replace(usual.optics.sensor, true_shutter=rule)
        lens, filter_ = (_panorama(rng), Filter()) if inside else (_fisheye(rng), _filter(rng))
        optics = replace(usual.optics, lens=lens, filter=filter_, sensor=sensor, glare=0.0)
        bodies[side] = HostileBody(optics, world=world)
    return bodies


def _copied(rng: np.random.Generator, usual: tuple[float, ...], loss_frac: float) -> tuple[float, ...]:
    """Return a copy's fall-off (see `mocks.optics.lenses`): turned 10 %, its knee 0.05 rad off, 1.5 % at the rim."""
    turn, knee_rad, loss = usual
    return (
        turn * float(rng.normal(1, 0.1)),
        knee_rad + float(rng.normal(0, 0.05)),
        loss * float(rng.normal(1, loss_frac)),
    )


def _panorama(rng: np.random.Generator) -> Lens:
    return EquirectangularLens(vignetting=_copied(rng, EquirectangularLens().vignetting, 0.3))


def _fisheye(rng: np.random.Generator) -> Lens:
    pairs = rng.normal(0, 0.004, (2, 2))
    circle, axis = ((float(right), float(up)) for right, up in pairs)
    vignetting = _copied(rng, EquisolidFisheye().vignetting, 0.2)
    return FisheyeCopy(vignetting=vignetting, bend=float(rng.normal(0, 0.006)), circle=circle, axis=axis)


def _filter(rng: np.random.Generator) -> Filter:
    tint = np.array(ND3_TINT) + rng.normal(0, 0.02, (3, 3))
    tint /= float(tint.sum(axis=0) @ np.array(LUMINANCE_WEIGHTS))
    rows = tuple((float(row[0]), float(row[1]), float(row[2])) for row in tint)
    return Filter(density=float(rng.normal(3.0, 0.05)), tint=(rows[0], rows[1], rows[2]))


def rig_figures(
    curves: Curves, draws: Sequence[int], divisor: int, wanted: int, kept: Row = fresh
) -> tuple[dict[str, float], list[str]]:
    """Return errors over rigs of these seeds until ``wanted`` are measured, and each rig's or why it was refused.

    ``divisor``: of full size; ``kept``: where a rig's row is kept.
    """
    found, notes = [], []
    for seed in draws:
        if len(found) == wanted:
            break
        row = kept(f"rig {seed} {divisor}", partial(_rig_row, curves, seed, divisor))
        if "refused" in row:
            notes.append(f"hostile rig {seed} refused: {row['refused']}")
        else:
            found.append(row)
    figures: dict[str, float] = {"hostile_rigs": len(found) + len(notes), "hostile_rigs_refused": len(notes)}
    for key in found[0] if found else ():
        values = [one[key] for one in found]
        figures[f"hostile_{key}"] = float(np.median(values))
        worst = key.replace("_err_pct", "_worst_pct") if key.endswith("_err_pct") else f"{key}_worst"
        figures[f"hostile_{worst}"] = max(values)
    if found:
        figures["hostile_lux_cover95_pct"] = 100 * float(np.mean([one["lux_sigmas"] <= 1.96 for one in found]))
    notes += [" ".join(f"{key} {value:.2f}" for key, value in one.items()) for one in found]
    return figures, notes


def _rig_row(curves: Curves, seed: int, divisor: int) -> dict[str, Any]:
    """Return one rig's errors, or why it was refused."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return rig_errors(Path(folder), hostile_bodies(curves, seed), divisor, seed)
        except ProcessingError as error:
            return {"refused": error.message[:160]}


def rig_errors(folder: Path, bodies: dict[Side, Body], divisor: int, seed: int) -> dict[str, float]:
    """Return one rig's errors in %, calibrated and measured in ``folder``."""
    rig = calibrated_rig(folder, divisor, seed, bodies)
    inside, outside = measured(folder / "room", rig, SimpleRoom(seed, gain=ROOM_GAIN), divisor, seed)
    own_lens = with_own_lens(folder, rig, divisor, seed)
    again = measured_again(folder / "room", own_lens, SimpleRoom(seed, gain=ROOM_GAIN), divisor, seed)
    k2 = rig.result.profile.k2
    assert k2 is not None
    off = abs(k2.value / rig.k2_truth - 1)
    return {
        "k1_err_pct": 100 * abs(inside.k1),
        "k2_err_pct": 100 * off,
        "k2_sigmas": off / k2.relative_uncertainty,
        "indoor_median_err_pct": 100 * inside.median,
        "indoor_p95_err_pct": 100 * inside.p95,
        "own_lens_indoor_median_err_pct": 100 * again.median,
        "own_lens_indoor_p95_err_pct": 100 * again.p95,
        "outdoor_lux_err_pct": 100 * abs(outside.lux),
        "lux_sigmas": abs(outside.lux) / ((1 + outside.lux) * outside.lux_stated),
        "sky_median_err_pct": 100 * outside.sky.median,
        "sky_p95_err_pct": 100 * outside.sky.p95,
        "sky_spot_p95_err_pct": 100 * outside.sky.spot_p95,
    }
