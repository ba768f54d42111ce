"""The simulated bench: a world, and three instruments looking at it behind real pyusb and real pyserial."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from drivers.clock import Clock, SystemClock
from mocks.instruments.canon_5d2 import CANON_TIMING, CanonOptions, SimulatedCanon5D2
from mocks.instruments.exposures import CameraTiming, ShotSource
from mocks.instruments.faults import FaultSchedule
from mocks.instruments.ls160 import MeterFault, SimulatedMeter
from mocks.instruments.serial_port import SerialPort
from mocks.instruments.theta_z1 import THETA_TIMING, SimulatedThetaZ1, ThetaOptions
from mocks.instruments.usb.bus import SimulatedUsbBackend
from mocks.optics.camera import CANON_5D2, THETA_Z1, CameraOptics, Filter
from mocks.optics.pictures import RenderedShots
from mocks.optics.sensor import Exposure
from mocks.worlds.light import Vector, World
from mocks.worlds.world import meter_luminance_cd_m2, open_world

SimulatedCamera = SimulatedThetaZ1 | SimulatedCanon5D2
OPTICS = {"theta_z1": THETA_Z1, "canon_5d2": CANON_5D2}
Progress: TypeAlias = Callable[[str, int, int], None]
"""Called with what is being made (light, indoor, outdoor), the steps done and the steps in all."""
MEASURING_S = 1.5  # of the simulated meter; a real one in AUTO takes 0.7 to 4.3 s


@dataclass(frozen=True)
class WantedCamera:
    """A camera that is wanted on the bench, and the settings its pictures are rendered for.

    Without ``nd_filter`` nothing is before its lens.
    """

    kind: str
    iso: int
    f_number: float
    color_temperature_k: int
    size_px: tuple[int, int]
    keep_raw: bool = False
    nd_filter: bool = True

    @property
    def optics(self) -> CameraOptics:
        """Return the lens, filter and sensor."""
        usual = OPTICS[self.kind]
        return usual if self.nd_filter else replace(usual, filter=Filter())


@dataclass(frozen=True)
class BenchOptions:
    """How the instruments behave; everything seeded.

    ``timing`` and ``faults`` are by camera kind; ``shots`` replaces rendered pictures (tests with their own).
    """

    seed: int = 0
    clock: Clock = field(default_factory=SystemClock)
    timing: Mapping[str, CameraTiming] = field(default_factory=dict)
    faults: Mapping[str, FaultSchedule] = field(default_factory=dict)
    meter_faults: tuple[MeterFault, ...] = ()
    measuring_s: float = MEASURING_S
    shots: Mapping[str, ShotSource] = field(default_factory=dict)
    times_s: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """By camera kind, when each stop is planned to begin (at once, where it does not say): what the light does until
    then shows in the frames."""
    theta: ThetaOptions | None = None
    canon: CanonOptions | None = None
    on_progress: Progress | None = None
    fresh: bool = False
    """Whether each exposure has noise of its own: see `RenderedShots`."""


@dataclass
class SimulatedBench:
    """The instruments, ready to be opened: cameras on ``usb_backend``, the meter on ``meter_port``."""

    world: World
    clock: Clock
    usb_backend: SimulatedUsbBackend
    cameras: dict[str, SimulatedCamera]
    """By kind."""
    meter: SimulatedMeter
    meter_port: str
    meter_direction: Vector
    _port: SerialPort

    @property
    def meter_target_deg(self) -> tuple[float, float]:
        """Where the meter looks: longitude (right of ahead) and latitude, degrees."""
        x, y, z = self.meter_direction
        return math.degrees(math.atan2(x, y)), math.degrees(math.asin(max(-1.0, min(1.0, z))))

    def close(self) -> None:
        """Unplug everything."""
        self._port.close()


def make_bench(
    world: World | str, cameras: Sequence[WantedCamera], stops_s: Sequence[float], options: BenchOptions | None = None
) -> SimulatedBench:
    """Return simulated instruments that look at a world, or at the one of that name (see
    `mocks.worlds.world.open_world`).

    The pictures of ``stops_s`` are rendered here, before anything is captured, and kept for next time. The world's
    time begins when this returns.

    Raises `WorldFileError`: no such world.
    """
    options = options or BenchOptions()
    world = open_world(world) if isinstance(world, str) else world
    shots = render_shots(world, cameras, stops_s, options)
    devices = {wanted.kind: _camera(wanted, shots[wanted.kind], options) for wanted in cameras}
    direction = _meter_direction(world)
    meter = SimulatedMeter(
        lambda t_s: meter_luminance_cd_m2(world, direction, t_s),
        language="ls160",
        measuring_s=options.measuring_s,
        faults=options.meter_faults,
        seed=options.seed,
    )
    port = SerialPort(meter, options.clock)
    backend = SimulatedUsbBackend(list(devices.values()), options.clock)
    return SimulatedBench(world, options.clock, backend, devices, meter, port.name, direction, port)


def render_shots(
    world: World, cameras: Sequence[WantedCamera], stops_s: Sequence[float], options: BenchOptions
) -> dict[str, ShotSource]:
    """Return the pictures of each camera, rendered unless they are kept from before.

    The world's light is made first, so that neither pictures nor the meter's first reading need wait for it.
    """
    report = options.on_progress or (lambda _what, _done, _total: None)
    report("light", 0, 1)
    meter_luminance_cd_m2(world, _meter_direction(world))
    report("light", 1, 1)
    found: dict[str, ShotSource] = {}
    for wanted in cameras:
        starts_s = options.times_s.get(wanted.kind) or [0.0] * len(stops_s)
        given = options.shots.get(wanted.kind)
        found[wanted.kind] = given or _rendered(world, wanted, dict(zip(stops_s, starts_s, strict=True)), options)
    return found


def _meter_direction(world: World) -> Vector:
    direction: Vector = getattr(world, "board_direction", (0.0, 1.0, 0.0))
    return direction


def _rendered(world: World, wanted: WantedCamera, stops: Mapping[float, float], options: BenchOptions) -> RenderedShots:
    """Return pictures of stops, given with their times."""
    report, site = options.on_progress, wanted.optics.site
    listener = (lambda done, total: report(str(site), done, total)) if report else None
    shots = RenderedShots(world, wanted.optics, seed=options.seed, fresh=options.fresh, on_progress=listener)
    settings = Exposure(1.0, wanted.iso, wanted.f_number, wanted.color_temperature_k)
    shots.prepare(tuple(stops), *wanted.size_px, settings=settings, times_s=tuple(stops.values()), raw=wanted.keep_raw)
    return shots


def _camera(wanted: WantedCamera, shots: ShotSource, options: BenchOptions) -> SimulatedCamera:
    clock, faults, seed = options.clock, options.faults.get(wanted.kind), options.seed
    if wanted.kind == "theta_z1":
        timing = options.timing.get(wanted.kind, THETA_TIMING)
        theta = options.theta or ThetaOptions(image_size_px=wanted.size_px)
        return SimulatedThetaZ1(shots, clock, timing=timing, options=theta, faults=faults, seed=seed)
    timing = options.timing.get(wanted.kind, CANON_TIMING)
    canon = options.canon or CanonOptions(image_size_px=wanted.size_px)
    return SimulatedCanon5D2(shots, clock, timing=timing, options=canon, faults=faults, seed=seed)
