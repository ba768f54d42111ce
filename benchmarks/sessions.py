"""Simulated rig and room sessions on disk, without waiting for shutters: frames rendered, manifest written beside."""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from mocks.instruments.exposures import ShotRequest
from mocks.optics.camera import CANON_5D2, THETA_Z1, CameraOptics, Filter, scene_rows
from mocks.optics.pictures import RenderedShots
from mocks.optics.sensor import Exposure
from mocks.worlds.light import Site, Vector, World
from mocks.worlds.world import meter_luminance_cd_m2
from processing.ground.arrays import Doubles, Floats
from station.session.session import (
    BracketRecord,
    DeviceRecord,
    FrameRecord,
    MeterTarget,
    ReadingRecord,
    SessionManifest,
    SettingRecord,
    Side,
)
from station.session.session import Site as Place

STOPS_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
NOWHERE = Place()
_BEGUN = datetime(2026, 6, 1, 12, 0, tzinfo=UTC)
_NAMES = {Side.INDOOR: ("Ricoh Company, Ltd.", "RICOH THETA Z1"), Side.OUTDOOR: ("Canon Inc.", "Canon EOS 5D Mark II")}


@dataclass(frozen=True)
class Body:
    """A camera in a session: the simulated rig's own, in whose place `benchmarks.hostile.rigs` puts others."""

    optics: CameraOptics
    known: bool = True
    """Whether all of it follows from its optics, as the sky with everything known needs."""

    def pictures(self, taken: Taken, side: Side) -> Callable[[ShotRequest], bytes]:
        """Return what gives the JPEG of each exposure of a session."""
        optics, (wide, high) = taken.optics(side), taken.size_px(side)
        usual = optics.usual_settings
        shots = RenderedShots(taken.world, optics, seed=taken.seed, fresh=True, workers=0)
        shots.prepare(taken.stops_s, wide, high, settings=Exposure(1.0, usual.iso, usual.f_number))
        return shots.jpeg

    def log2_exposure(self) -> Doubles:
        """Return the true curve (3, 256): exposure, 1 at saturation, of each code; codes 0 and 255 are not meant."""
        codes = np.clip(np.arange(256), 0.25, 255) / 255
        return np.stack([np.log2(tone.decode(codes)) for tone in self.optics.sensor.tone])

    def truth(self, taken: Taken, side: Side, bands: Sequence[range]) -> Floats:
        """Return the radiance (h, W, 3) in cd/m2 that the pixels of bands of rows truly average."""
        return np.concatenate([scene_rows(taken.world, self.optics, taken.size_px(side), band) for band in bands])

    def shown_share(self, taken: Taken, target_cd_m2: float, mean_cd_m2: float) -> float:
        """Return what the lens shows of the meter's target over what it has; ``mean``: of all light."""
        return 1 - self.optics.glare + self.optics.glare * mean_cd_m2 / target_cd_m2


BODIES: Mapping[Side, Body] = {Side.INDOOR: Body(THETA_Z1), Side.OUTDOOR: Body(CANON_5D2)}


@dataclass(frozen=True)
class Taken:
    """What a session is to be: the world, how small the pictures, which cameras, with the ND filter or without."""

    world: World
    divisor: int = 8
    sides: tuple[Side, ...] = (Side.INDOOR, Side.OUTDOOR)
    nd: bool = True
    stops_s: Sequence[float] = STOPS_S
    seed: int = 0
    begun: datetime = _BEGUN
    place: Place = NOWHERE
    heading_rad: float | None = None
    raw: Mapping[Side, float] = field(default_factory=dict)
    """Cameras that leave a DNG beside each JPEG (no program decodes the simulated CR2), and at what share of the
    sensor's counts it says that wells are full: a scale of its own."""
    bodies: Mapping[Side, Body] = field(default_factory=lambda: BODIES)

    def optics(self, side: Side) -> CameraOptics:
        """Return the camera."""
        usual = self.bodies[side].optics
        return usual if self.nd else replace(usual, filter=Filter())

    def size_px(self, side: Side) -> tuple[int, int]:
        """Return the pictures' width and height."""
        wide, high = self.optics(side).full_size
        return wide // self.divisor // 2 * 2, high // self.divisor // 2 * 2


def write_session(path: Path, taken: Taken) -> Path:
    """Write the session and return its folder."""
    frames = [record for side in taken.sides for record in _write_frames(path, taken, side)]
    target = getattr(taken.world, "board_direction", (0.0, 1.0, 0.0))
    manifest = SessionManifest(
        session_id=hashlib.sha256(str((path.name, taken.seed, taken.world.key)).encode()).hexdigest()[:32],
        name=path.name,
        created_utc=taken.begun,
        simulated=True,
        site=taken.place,
        heading_rad=taken.heading_rad,
        bracket=BracketRecord(mode="full", stops_s=tuple(taken.stops_s), sides=taken.sides),
        devices=tuple(_device(taken, side) for side in taken.sides),
        frames=tuple(frames),
        target=_target(target),
        readings=tuple(_readings(taken, target)) if Side.INDOOR in taken.sides else (),
        readings_planned=2 if Side.INDOOR in taken.sides else 0,
    ).assess()
    (path / "session.json").write_text(manifest.model_dump_json(indent=1))
    return path


def _dng_of(taken: Taken, side: Side) -> Callable[[ShotRequest], bytes]:
    """Return what gives the DNG of each exposure."""
    optics, (wide, high) = taken.optics(side), taken.size_px(side)
    usual, sensor = optics.usual_settings, optics.sensor
    shots = RenderedShots(taken.world, optics, seed=taken.seed, fresh=True, workers=0)
    shots.prepare(taken.stops_s, wide, high, settings=Exposure(1.0, usual.iso, usual.f_number), raw=True)

    def made(request: ShotRequest) -> bytes:
        dng = shots.raw(replace(request, manufacturer="Adobe"))
        return _full_at(dng, sensor.raw_black, 2**sensor.raw_bits - 1, taken.raw[side])

    return made


def _write_frames(path: Path, taken: Taken, side: Side) -> list[FrameRecord]:
    folder = path / side.value
    folder.mkdir(parents=True)
    optics, (wide, high) = taken.optics(side), taken.size_px(side)
    picture = taken.bodies[side].pictures(taken, side)
    usual, (maker, model) = optics.usual_settings, _NAMES[side]
    dng = _dng_of(taken, side) if side in taken.raw else None
    records = []
    for stop, shutter_s in enumerate(taken.stops_s):
        moment = taken.begun + timedelta(seconds=10 + 2 * (len(taken.stops_s) - stop))
        request = ShotRequest(
            shutter_s,
            usual.iso,
            usual.f_number,
            6500,
            wide,
            high,
            moment.replace(tzinfo=None),
            stop + 1,
            maker,
            model,
            "1001",
            "1.0",
        )
        files = {"jpeg": picture(request)} | ({"dng": dng(request)} if dng else {})
        for kind, data in files.items():
            name = f"{side.value}/{stop:02d}.{'jpg' if kind == 'jpeg' else kind}"
            (path / name).write_bytes(data)
            records.append(
                FrameRecord(
                    side=side,
                    stop=stop,
                    file=name,
                    format="dng" if kind == "dng" else "jpeg",
                    size_bytes=len(data),
                    sha256=hashlib.sha256(data).hexdigest(),
                    asked_s=shutter_s,
                    camera_s=shutter_s,
                    iso=usual.iso,
                    f_number=usual.f_number,
                    width_px=wide,
                    height_px=high,
                    taken_utc=moment,
                    release_monotonic_s=(moment - taken.begun).total_seconds(),
                )
            )
    return records


def _full_at(dng: bytes, black: int, white: int, share: float) -> bytes:
    """Return a DNG whose white level (tag 50717) is a share of what it was, above the black level."""
    before, after = (struct.pack("<HHIH", 50717, 3, 1, round(black + s * (white - black))) for s in (1.0, share))
    assert dng.count(before) == 1
    return dng.replace(before, after)


def _device(taken: Taken, side: Side) -> DeviceRecord:
    maker, model = _NAMES[side]
    usual = taken.optics(side).usual_settings
    outdoor = side is Side.OUTDOOR
    return DeviceRecord(
        role=side.value,
        kind="canon_5d2" if outdoor else "theta_z1",
        manufacturer=maker,
        model=model,
        serial="1001",
        simulated=True,
        lens="EF 8-15mm f/4L FISHEYE USM at 8 mm" if outdoor else "",
        nd_filter="ND 3.0" if outdoor and taken.nd else "",
        settings=(SettingRecord(name="colour temperature", asked="6500 K", got=f"{usual.color_temperature_k} K"),),
    )


def _target(way: Vector) -> MeterTarget:
    x, y, z = way
    return MeterTarget(longitude_rad=math.atan2(x, y), latitude_rad=math.asin(max(-1.0, min(1.0, z))))


def _readings(taken: Taken, way: Vector) -> list[ReadingRecord]:
    """Return the readings before and after, as an LS-160 shows them (four digits)."""
    found = []
    for when, at_s in (("before", 0.0), ("after", 40.0)):
        true = meter_luminance_cd_m2(taken.world, way, at_s, site=Site.INDOOR)
        digits = max(0, 3 - math.floor(math.log10(true)))
        shown = f"{true:.{digits}f}"
        found.append(
            ReadingRecord(
                when="before" if when == "before" else "after",
                status="ok",
                luminance_cd_m2=float(shown),
                taken_utc=taken.begun + timedelta(seconds=at_s),
                taken_monotonic_s=at_s,
                raw=shown,
                dialect="ls160",
                n_samples=3,
            )
        )
    return found
