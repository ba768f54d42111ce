"""One rig calibrated and its sessions scaled, beside what the simulated world truly radiates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.photometry.sky_floor import SkyErrors, sky_all_known, sky_errors
from benchmarks.sessions import BODIES, STOPS_S, Body, Taken, write_session
from mocks.optics.chart import ChartRoom
from mocks.optics.lenses import EquirectangularLens
from mocks.worlds.light import Site, UniformWorld, Vector, World, luminance_cd_m2, unit
from mocks.worlds.simple_room import SimpleRoom
from processing.calibration.optics import glare_taken_off
from processing.calibration.outdoor import outdoor
from processing.calibration.outdoor.outdoor import OutdoorOptics, OutdoorView, outdoor_view
from processing.calibration.outdoor.session_sky import with_shared_modes
from processing.calibration.scale.luminance import ScaleFactor, combined, scale_from_reading, scaled
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.veiling_glare import without_glare
from processing.ground.arrays import Doubles, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.images import Validity
from processing.rig.calibrate import RigRequest, RigResult, calibrate_rig
from processing.rig.camera_fit import SessionSide, read_side, with_falloff, with_lamps
from processing.sphere import Fisheye, solid_angles
from station.session.session import Side

DENSE_STOPS_S = (
    4.0,
    2.5,
    1.0,
    0.6,
    1 / 4,
    1 / 6,
    1 / 15,
    1 / 25,
    1 / 60,
    1 / 100,
    1 / 250,
    1 / 400,
    1 / 1000,
    1 / 1600,
)
"""For response curves: steps of different size, so that no wave in the curve repeats from frame to frame."""
CHART_STOPS_S = (30.0, 20.0, 10.0, *STOPS_S)
"""For the chart, which is dim through the ND filter."""
LAMPS = ((0.3, 0.9, 0.3), (-0.2, -0.9, 0.3))
"""Where they stand in the dark room: one before each lens of the panorama camera."""
TURN_RAD = math.radians(80)
_SUN_RAD = math.radians(3)
_EDGE_RATIO = 1.1
_BAND = 12


@dataclass(frozen=True)
class Calibrated:
    """A rig with what is true of it."""

    result: RigResult
    k2_truth: float
    bodies: Mapping[Side, Body]


def calibrated_rig(folder: Path, divisor: int, seed: int, bodies: Mapping[Side, Body] = BODIES) -> Calibrated:
    """Make rig sessions and calibrate from them; the k2 that is true follows from both curves' gauges."""

    def session(name: str, world: World, *sides: Side, stops_s: Sequence[float] = STOPS_S, nd: bool = True) -> Path:
        taken = Taken(world, divisor, sides or tuple(Side), nd=nd, stops_s=stops_s, seed=seed, bodies=bodies)
        return write_session(folder / name, taken)

    chart = session("chart", ChartRoom(seed % 5), stops_s=CHART_STOPS_S)
    room = session("response", SimpleRoom(seed), Side.INDOOR, stops_s=DENSE_STOPS_S)
    plain = session("plain", ChartRoom(seed % 5), Side.OUTDOOR, nd=False, stops_s=DENSE_STOPS_S)
    flat = session("flat", UniformWorld(20_000.0), Side.OUTDOOR)
    request = RigRequest(chart, (room,), (flat,), (chart, plain), ("theta_z1",))
    result = calibrate_rig(request, datetime.now(UTC))
    gains = [_gain(result, side, bodies[side]) for side in (Side.INDOOR, Side.OUTDOOR)]
    return Calibrated(result, gains[0] / gains[1], bodies)


@dataclass(frozen=True)
class LampRoom(UniformWorld):
    """A dark room with a lamp of 3 degrees; or the lamp hidden by a black card."""

    lamp: Vector = LAMPS[0]
    hidden: bool = False

    def radiance(self, site: Site, directions: Floats, pixel_rad: float = 0.0, component: int | None = None) -> Floats:
        """Return the radiance (..., 3) of directions, cd/m2."""
        cosine = directions @ np.array(unit(self.lamp), np.float32)
        light = np.where(cosine > math.cos(math.radians(6)), 0.01 if self.hidden else 0.5, np.float32(0.5))
        if not self.hidden:
            light = np.where(cosine > math.cos(math.radians(1.5)), 40_000.0, light)
        return np.repeat(light[..., None], 3, axis=-1).astype(np.float32)


def with_own_lens(folder: Path, rig: Calibrated, divisor: int, seed: int) -> Calibrated:
    """Return the rig with the panorama camera's stray light and fall-off as lamps and turning show them.

    By pictures of half the size: a lens's light does not depend on it.
    """
    camera, body = rig.result.cameras[Side.INDOOR], rig.bodies[Side.INDOOR]
    lens = body.optics.lens
    assert isinstance(lens, EquirectangularLens)
    aside = replace(body, optics=replace(body.optics, lens=replace(lens, yaw_rad=TURN_RAD)))

    def taken(name: str, world: World, one: Body) -> SessionSide:
        bodies = {**rig.bodies, Side.INDOOR: one}
        found = read_side(
            write_session(folder / name, Taken(world, 2 * divisor, (Side.INDOOR,), seed=seed, bodies=bodies)),
            Side.INDOOR,
        )
        assert found is not None
        return found

    pairs = [
        (taken(f"lamp-{n}", LampRoom(lamp=at), body), taken(f"hidden-{n}", LampRoom(lamp=at, hidden=True), body))
        for n, at in enumerate(LAMPS)
    ]
    turns = [taken(f"turn-{n}", SimpleRoom(seed), one) for n, one in enumerate((body, aside))]
    cameras = {**rig.result.cameras, Side.INDOOR: with_falloff(with_lamps(camera, pairs), turns)}
    return replace(rig, result=replace(rig.result, cameras=cameras))


def measured_again(path: Path, rig: Calibrated, world: World, divisor: int, seed: int) -> Indoor:
    """Return the errors of an indoor session that `measured` has written, by another calibration."""
    side = read_side(path, Side.INDOOR)
    assert side is not None
    return _indoor(rig, Taken(world, divisor, seed=seed, bodies=rig.bodies), side)[1]


def _gain(result: RigResult, side: Side, body: Body) -> float:
    """Return the corrected luminance of 1 cd/m2 of neutral light in the middle of the field, by the body's true curve.

    Corrected as the product does it: k2 is of pictures whose filter's tint is undone, and makes up for what that
    leaves wrong of white.
    """
    optics = body.optics
    curve = result.cameras[side].response.curve
    exposure = optics.sensor.exposure_gain(optics.usual_settings) / optics.sensor.true_shutter.seconds(1.0)
    z = np.arange(64, 220)
    # The gauge is a choice of scale: it is where the true curve lies over the recovered one, over the middle codes.
    off = (body.log2_exposure() - curve.log2_exposure)[:, z]
    # The simulated cameras' channels have one gauge within 0.009 stop; published curves' differ by up to half a stop.
    gauges = 2 ** np.median(off, axis=None if body.known else 1, keepdims=True).ravel()
    gauges = np.broadcast_to(gauges, 3)
    shown = np.ones(3) @ np.array(optics.filter.tint) / gauges
    if (found := result.cameras[side].filter) is not None:
        shown = shown @ found.correction
    return exposure * 10**-optics.filter.density * float(shown @ np.array(LUMINANCE_WEIGHTS))


@dataclass(frozen=True)
class Indoor:
    """Errors of one indoor session, relative; by solid angle."""

    k1: float
    k1_without_glare: float
    median: float
    p95: float
    smooth_median: float
    smooth_p95: float
    covered: float


@dataclass(frozen=True)
class Outdoor:
    """Errors of one outdoor session, relative."""

    lux: float
    lux_stated: float
    """Standard uncertainty of the illuminance over its value, as the product states it."""
    sky: SkyErrors
    sky_floor: SkyErrors | None
    """Of the same frames with true curve, noise, veil, fall-off, tint and scale; None where it is not known."""
    clipped_share: float


def measured(
    folder: Path, rig: Calibrated, world: World, divisor: int, seed: int, stops_s: Sequence[float] = STOPS_S
) -> tuple[Indoor, Outdoor]:
    """Take a session of a world, scale it by its meter and k2, and compare with the world's own radiance."""
    taken = Taken(world, divisor, stops_s=stops_s, seed=seed, bodies=rig.bodies)
    path = write_session(folder, taken)
    inside, outside = read_side(path, Side.INDOOR), read_side(path, Side.OUTDOOR)
    assert inside is not None
    assert outside is not None
    k1, indoor = _indoor(rig, taken, inside)
    return indoor, _outdoor(rig, taken, outside, k1)


def _indoor(rig: Calibrated, taken: Taken, side: SessionSide) -> tuple[ScaleFactor, Indoor]:
    camera = rig.result.cameras[Side.INDOOR]
    merged = camera.merged(side)
    image = camera.corrected(without_glare(merged, camera.glare) if camera.glare else merged)
    assert side.target is not None
    k1 = scale_from_reading(
        image, side.readings, side.target.longitude_rad, side.target.latitude_rad, frames=side.records
    )
    rows, scene = _truth(taken, Side.INDOOR)
    truth = luminance_cd_m2(scene).astype(np.float64)
    solid = solid_angles(image.geometry)[rows]
    shown = luminance_cd_m2(scaled(image, k1).rgb[rows])
    use = (image.validity[rows] == Validity.VALID) & (truth > 0)
    error = np.abs(shown / np.maximum(truth, 1e-9) - 1)
    smooth = use & ~_edges(truth)
    body = rig.bodies[Side.INDOOR]
    k1_truth = 1 / _gain(rig.result, Side.INDOOR, body)
    # What the lens scatters is in the picture of the board, and not in the meter; unless it was taken off.
    mean = float((truth * solid).sum() / solid.sum())
    shown_share = 1.0 if camera.glare else body.shown_share(taken, k1.measured, mean)
    return k1, Indoor(
        k1=k1.value / (k1_truth / shown_share) - 1,
        k1_without_glare=k1.value / k1_truth - 1,
        median=_quantile(error[use], solid[use], 0.5),
        p95=_quantile(error[use], solid[use], 0.95),
        smooth_median=_quantile(error[smooth], solid[smooth], 0.5),
        smooth_p95=_quantile(error[smooth], solid[smooth], 0.95),
        covered=float(solid[use].sum() / solid.sum()),
    )


def _outdoor(rig: Calibrated, taken: Taken, side: SessionSide, k1: ScaleFactor) -> Outdoor:
    camera = rig.result.cameras[Side.OUTDOOR]
    assert camera.lens is not None
    k2 = rig.result.profile.k2
    assert k2 is not None
    scale = combined(k1, ScaleFactor(k2.value, k2.relative_uncertainty))
    merged = camera.merged(side)
    assert isinstance(merged.geometry, Fisheye)
    merged, kernel, _ = glare_taken_off(merged, merged.geometry)
    sky = camera.corrected(merged)
    rows, scene = _truth(taken, Side.OUTDOOR)
    truth = luminance_cd_m2(scene).astype(np.float64)
    shown = luminance_cd_m2(scaled(sky, scale).rgb[rows]).astype(np.float64)
    x = np.arange(truth.shape[1]) + 0.5
    y = (rows + 0.5)[:, None]
    lens = taken.optics(Side.OUTDOOR).lens
    ways, seen = lens.directions(x, y, taken.size_px(Side.OUTDOOR))
    use = seen & (sky.validity[rows] == Validity.VALID) & (ways[..., 2] > math.sin(math.radians(3)))
    for disc in taken.world.discs(Site.OUTDOOR):
        use &= ways @ np.array(disc.direction, dtype=np.float32) < math.cos(_SUN_RAD)
    pixel_sr = 2 * math.pi / (math.pi * camera.lens.circle.radius_px**2)
    optics = OutdoorOptics(camera.lens, camera.vignetting, camera.filter)
    view = outdoor_view(OutdoorView.HEMISPHERICAL, max(64, round(2 * camera.lens.circle.radius_px)))
    lit = outdoor.correct_vignetting(outdoor.with_lens(merged, optics), optics)
    flat = scaled(outdoor.project(outdoor.correct_colour(lit, optics), view), scale)
    lux = illuminance_lx(with_shared_modes(flat, optics, kernel, (None, k2.light)))
    true_lux = _true_lux(taken.world)
    known = sky_all_known(camera, taken, side, rows, scene) if rig.bodies[Side.OUTDOOR].known else None
    return Outdoor(
        lux=lux.value_lx / true_lux - 1,
        lux_stated=lux.uncertainty_lx / lux.value_lx,
        sky=sky_errors(shown, truth, use, rows, pixel_sr),
        sky_floor=None if known is None else sky_errors(known, truth, use, rows, pixel_sr),
        clipped_share=float(np.mean(sky.validity[rows][seen] == Validity.CLIPPED)),
    )


def _true_lux(world: World) -> float:
    """Return the horizontal illuminance of the sky by midpoints of equal solid angle, and of the discs exactly."""
    rows, columns = 720, 1440
    height = (np.arange(rows) + 0.5) / rows
    turn = (np.arange(columns) + 0.5) / columns * 2 * math.pi
    flat = np.sqrt(1 - height**2)
    ways = np.stack(
        np.broadcast_arrays(
            flat[:, None] * np.sin(turn), flat[:, None] * np.cos(turn), height[:, None] * np.ones_like(turn)
        ),
        axis=-1,
    ).astype(np.float32)
    level = luminance_cd_m2(world.radiance(Site.OUTDOOR, ways)).astype(np.float64)
    total = float((level * height[:, None]).mean()) * 2 * math.pi
    for disc in world.discs(Site.OUTDOOR):
        shine = float(luminance_cd_m2(np.array(disc.radiance_rgb, dtype=np.float32)))
        total += shine * disc.solid_angle_sr * max(disc.direction[2], 0.0)
    return total


def _truth(taken: Taken, side: Side) -> tuple[npt.NDArray[np.intp], Floats]:
    """Return some bands of rows and the radiance (h, W, 3) that each of their pixels truly averages.

    Without fall-off, filter or glare; a quarter of the picture, as each costs as much as all of its frames.
    """
    size = taken.size_px(side)
    bands = [range(first, min(first + _BAND, size[1])) for first in range(0, size[1], 4 * _BAND)]
    return np.concatenate([np.array(band) for band in bands]), taken.bodies[side].truth(taken, side, bands)


def _edges(truth: Doubles) -> npt.NDArray[np.bool_]:
    """Return pixels within two of a neighbour that is 10 % brighter or darker: JPEG and mixed pixels."""
    import cv2

    level = np.log(np.maximum(truth, 1e-9)).astype(np.float32)
    span = cv2.dilate(level, np.ones((3, 3), np.uint8)) - cv2.erode(level, np.ones((3, 3), np.uint8))
    near = cv2.dilate((span > math.log(_EDGE_RATIO)).astype(np.uint8), np.ones((5, 5), np.uint8))
    return np.asarray(near > 0)


def _quantile(values: Doubles, weights: Doubles, share: float) -> float:
    order = np.argsort(values)
    summed = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(summed, share * summed[-1])])
