"""Opens the instruments that rig.toml names, or simulated ones; the only place that knows which are which."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.camera import Camera
from drivers.clock import Clock, SteadyClock, SystemClock
from drivers.meter.interface import Meter
from station.capture.links import Links
from station.capture.rig_file import CameraTable, RigFile
from station.errors import RigError, SessionError
from station.frames.check import FrameChecker
from station.session.session import ReadingRecord, SessionManifest, Side

if TYPE_CHECKING:
    from concurrent.futures import Future

    from drivers.ptp.pipes import PtpTransport
    from mocks.instruments.bench import SimulatedBench, WantedCamera
SAME_ON_RESUME = ("kind", "iso", "f_number", "color_temperature_k", "size_px", "keep_raw", "lens", "nd_filter")
"""Keys of a camera's table that the frames of one bracket must share."""
_SIMULATED_PREFLIGHT_S = 1.0  # chosen: roughly what simulated bodies take
SIZE_STEPS = {"full": 1, "half": 2, "quarter": 4, "small": 16}
"""Picture sizes of simulated cameras, as divisors of the full size."""


@dataclass
class Rig:
    """The instruments of a capture, not yet connected."""

    file: RigFile
    cameras: dict[Side, Camera]
    meter: Meter | None
    clock: SteadyClock
    simulated: bool = False
    bench: SimulatedBench | None = None
    on_close: list[Callable[[], None]] = field(default_factory=list)
    world: str = ""
    """What simulated instruments look at: recorded, so that a session can be resumed."""
    checkers: dict[Side, FrameChecker] | None = None
    """Where many captures follow one another: their frame checkers, kept between them; closed with the rig."""
    reading: Future[ReadingRecord] | None = None
    """The meter's last reading: it may still run when the capture that began it has failed."""

    def close(self) -> None:
        """Leave every instrument usable; raises only where a transcript is not whole (`Links.close`)."""
        for camera in self.cameras.values():
            camera.close()
        if self.meter is not None:
            self.meter.close()
        for checker in (self.checkers or {}).values():
            checker.close()
        for action in self.on_close:
            action()


def require_same_camera(rig: Rig, manifest: SessionManifest, side: Side, where: str) -> None:
    """Refuse, with `SessionError`, to mix frames of two settings in one bracket."""
    was = manifest.rig.get(side.value)
    if not isinstance(was, dict):
        return  # nothing is known of it
    now = rig.file.cameras()[side].model_dump(mode="json")
    changed = [f"{key} was {was[key]}, is {now[key]}" for key in SAME_ON_RESUME if was.get(key, now[key]) != now[key]]
    if changed:
        advice = "use the rig (and --size) it was recorded with"
        raise SessionError(f"the rig has another {side} camera: {'; '.join(changed)}", where=where, advice=advice)


def open_rig(file: RigFile, clock: Clock | None = None, links: Links | None = None) -> Rig:
    """Return a rig of real instruments; nothing is opened before `Camera.connect` and `Meter.connect`.

    Raises `RigError`: A meter dialect that does not exist.
    """
    steady, links = SteadyClock(clock or SystemClock()), links or Links()
    cameras = {side: _camera(side, table, None, steady, links) for side, table in file.cameras().items()}
    meter = meter_on_port(t.dialect, t.port, steady, links) if (t := file.meter) and t.is_read else None
    file = _with_lags(file, lambda side, _table: cameras[side].release_lag_s)
    return Rig(file, cameras, meter, steady, on_close=[links.close])


def _with_lags(file: RigFile, lag_s: Callable[[Side, CameraTable], float]) -> RigFile:
    """Return the rig file with the release lags that it does not give, seconds: a session is to keep what was used."""
    lacking = {side: table for side, table in file.cameras().items() if table.release_lag_s is None}
    filled = {s.value: table.model_copy(update={"release_lag_s": lag_s(s, table)}) for s, table in lacking.items()}
    return file.model_copy(update=filled)


def open_simulated_rig(
    file: RigFile, bench: SimulatedBench, links: Links | None = None, *, clock: Clock | None = None, world: str = ""
) -> Rig:
    """Return a rig whose instruments are those of ``bench``: the drivers are the real ones, the links end in mocks.

    The meter looks where the bench's meter does, unless the rig file says otherwise. ``clock``: the computer's, where
    it is not the instruments'.
    """
    steady = SteadyClock(clock or bench.clock)
    if file.meter is not None and file.meter.target_deg is None:
        file = file.model_copy(update={"meter": file.meter.model_copy(update={"target_deg": bench.meter_target_deg})})
    file = _with_lags(file, lambda _side, table: bench.cameras[table.kind].timing.release_lag_s)
    backend, links = bench.usb_backend, links or Links(simulated=True)
    cameras = {side: _camera(side, table, backend, steady, links) for side, table in file.cameras().items()}
    meter = meter_on_port(t.dialect, bench.meter_port, steady, links) if (t := file.meter) and t.is_read else None
    on_close = [bench.close, links.close]
    return Rig(file, cameras, meter, steady, simulated=True, bench=bench, on_close=on_close, world=world)


def _camera(side: Side, table: CameraTable, backend: object | None, clock: Clock, links: Links) -> Camera:
    from drivers.canon_5d2 import codes as canon_codes
    from drivers.theta_z1 import codes as ricoh_codes
    from drivers.usb_link import UsbLink

    vendor_id, product_id = ricoh_codes.USB_ID if table.kind == "theta_z1" else canon_codes.USB_ID

    def open_transport() -> PtpTransport:
        serial = table.serial or None
        return links.camera(
            side, lambda: UsbLink.open(vendor_id, product_id, serial=serial, backend=backend, clock=clock)
        )

    if table.kind == "theta_z1":
        from drivers.theta_z1.camera import ThetaZ1

        return ThetaZ1(open_transport, clock)
    from drivers.canon_5d2.camera import Canon5D2

    # A simulated camera calls its one picture size "large", whatever it is.
    real = backend is None and not links.simulated
    sizes_px = canon_codes.IMAGE_SIZES_PX if real else {canon_codes.IMAGE_SIZE_LARGE: table.size_px}
    return Canon5D2(open_transport, clock, destination=table.destination or "card", sizes_px=sizes_px)


def known_times_s(kind: str) -> tuple[float, ...]:
    """Return the exposure times of a kind of camera, seconds: by Ricoh's specification, and the thirds of EOS."""
    from drivers.canon_5d2.codes import SHUTTER_CODES
    from drivers.theta_z1.codes import SHUTTER_FRACTIONS

    if kind == "theta_z1":
        return tuple(numerator / denominator for numerator, denominator in SHUTTER_FRACTIONS)
    return tuple(SHUTTER_CODES.values())


def meter_on_port(dialect_name: str, port: str, clock: Clock, links: Links | None = None) -> Meter:
    """Return the meter of a dialect on a serial port; ``"auto"`` looks for its USB ids each time it connects.

    Raises `DialectError`: no such dialect, or a file that is none.
    """
    from drivers.meter.dialect import load_dialect
    from drivers.meter.ls160 import KonicaMinoltaMeter
    from drivers.serial_link import PortOpener

    dialect = load_dialect(dialect_name)
    settings, opener = dialect.port, links or Links()
    open_line = PortOpener(port, settings, usb_ids=dialect.usb_ids, clock=clock)
    return KonicaMinoltaMeter(lambda: opener.meter(open_line, str(settings)), dialect, clock)


def open_named_rig(
    path: Path | RigFile | None,
    simulate: str | None,
    *,
    size: str = "full",
    rate: float = 1.0,
    on_progress: Callable[[str, int, int], None] | None = None,
    in_its_place: bool = False,
    record: Path | None = None,
    fresh: bool = False,
    **changes: object,
) -> Rig:
    """Return the rig of a file, or simulated instruments looking at the world named ``simulate``.

    Without a file, simulated instruments are those of the paper. ``size`` is a key of `SIZE_STEPS` (simulated only);
    ``rate``: how much faster than life simulated time runs; ``on_progress`` hears what is being rendered, steps done
    and steps in all; ``in_its_place``: the rig stands where a generated room does, at its time, and knows its heading,
    so that the sun is where it should be; ``record``: write a transcript of all links there (`drivers.transcript`);
    ``fresh``: a picture taken again has noise of its own; ``simulate`` may be ``recorded:FILE``: such a transcript is
    replayed; ``changes`` replace tables of the rig file (``outdoor=None``).

    Raises `RigError`: no rig file, or one that cannot be right; `ResourceError`: the transcript cannot be written.
    """
    from station.capture.links import RECORDED, open_links, replayed_links
    from station.capture.rig_file import PAPER_RIG, load_rig

    if simulate and simulate.startswith(RECORDED):
        links, file = replayed_links(Path(simulate.removeprefix(RECORDED)))
        rig = open_rig(file.model_copy(update=changes), None, links)
        rig.simulated = True
        return rig
    if isinstance(path, RigFile):
        file = path
    else:
        file = PAPER_RIG if simulate and path is None else load_rig(find_rig_file(path))
    file = file.model_copy(update=changes)
    clock: Clock
    if not simulate:
        clock = SystemClock()
        return open_rig(file, clock, open_links(record, file, clock, simulated=False))
    from mocks.instruments.bench import BenchOptions, make_bench, render_shots
    from mocks.instruments.clock import ScaledClock
    from mocks.worlds.world import open_world

    place, start_utc = _place_of(simulate) if in_its_place else ({}, None)
    # Threads of this computer open the simulated shutters: what they are late by counts ``rate`` times.
    limits = file.limits.model_copy(update={"max_start_skew_s": rate * file.limits.max_start_skew_s})
    file = simulated_rig_file(file.model_copy(update={**place, "limits": limits}), size)
    cameras, stops_s = wanted_cameras(file), file.bracket.stops_s()
    world, times_s = open_world(simulate), planned_times_s(file)
    # Rendering takes minutes, in which the sun must not move on: time begins when all pictures are there.
    shots = render_shots(world, cameras, stops_s, BenchOptions(on_progress=on_progress, fresh=fresh, times_s=times_s))
    as_lived = rate == 1.0 and start_utc is None
    clock = SystemClock() if as_lived else ScaledClock(rate, start_utc or SystemClock().utc_now())
    bench = make_bench(world, cameras, stops_s, BenchOptions(clock=clock, shots=shots))
    return open_simulated_rig(file, bench, open_links(record, file, clock, simulated=True), world=simulate)


def _place_of(simulate: str) -> tuple[dict[str, object], datetime | None]:
    """Return tables of the rig file as they are in a generated room, and its moment; nothing for other worlds."""
    from mocks.rooms.world import RoomWorld
    from mocks.worlds.world import open_world
    from station.session.session import Site

    world = open_world(simulate)
    if not isinstance(world, RoomWorld):
        return {}, None
    moment, plan = world.room.moment, world.room.plan
    place = Site(latitude_deg=moment.latitude_deg, longitude_deg=moment.longitude_deg)
    heading_deg = round(math.degrees(moment.heading_rad), 4)
    return {"site": place, "heading_deg": heading_deg, "camera_height_m": plan.camera_height_m}, moment.utc


def simulated_renderer() -> str:
    """Return what renders generated rooms here, in words; takes seconds once on a computer, then none.

    Raises `DaylitError`: none can: a library is missing, or the renderer asked for is.
    """
    from mocks.rooms.light.engine import EngineError, engine, missing_libraries

    if missing := missing_libraries():
        text = f"{', '.join(missing)} not installed: rooms cannot be generated"
        likely = "a system without these packages (Linux on ARM), or an incomplete installation"
        advice = "capture works without them; for generated rooms reinstall daylit (make demo) or use x86-64"
        raise EngineError(text, likely=likely, advice=advice)
    return str(engine())


def planned_times_s(file: RigFile) -> dict[str, tuple[float, ...]]:
    """Return when each stop of the rig's bracket will begin on simulated instruments, by camera kind.

    Seconds from their making; right to about a second, in which daylight changes little.
    """
    from station.capture.bracket import TYPICAL_READING_S, estimate_bracket, plan_bracket, typical_cost

    tables = file.cameras()
    stops_s = file.bracket.stops_s()
    plan = plan_bracket(stops_s, file.bracket.mode, tuple(tables))
    costs = {side: typical_cost(table.kind, keep_raw=table.keep_raw) for side, table in tables.items()}
    start_s = _SIMULATED_PREFLIGHT_S + (TYPICAL_READING_S if file.meter and file.meter.is_read else 0.0)
    starts = {}
    for row in estimate_bracket(plan, costs).rows:
        starts[row.asked_s] = start_s
        start_s += row.pair_s
    return {table.kind: tuple(starts[stop] for stop in stops_s) for table in tables.values()}


def wanted_cameras(file: RigFile) -> list[WantedCamera]:
    """Return the cameras of a rig file as the simulated bench wants them."""
    from mocks.instruments.bench import WantedCamera

    names = ("kind", "iso", "f_number", "color_temperature_k", "size_px", "keep_raw")
    return [
        WantedCamera(**{n: getattr(table, n) for n in names}, nd_filter=bool(table.nd_filter))
        for table in file.cameras().values()
    ]


def simulated_rig_file(file: RigFile, size: str) -> RigFile:
    """Return the rig file with the pictures of its cameras at a fraction of their size."""
    step = SIZE_STEPS[size]
    changes: dict[str, object] = {}
    for side, table in file.cameras().items():
        width_px, height_px = (n // step // 2 * 2 for n in table.size_px)
        changes[side.value] = table.model_copy(update={"size_px": (width_px, height_px)})
    return file.model_copy(update=changes)


def find_rig_file(path: Path | None) -> Path:
    """Return the rig file to use: the one given, else ``rig.toml`` here, else the one in the user's config folder.

    Raises `RigError`: none of them exists.
    """
    if path is not None:
        return path
    from platformdirs import user_config_path

    for candidate in (Path("rig.toml"), user_config_path("daylit") / "rig.toml"):
        if candidate.is_file():
            return candidate
    text = "no rig file: neither ./rig.toml nor one in your configuration folder"
    raise RigError(text, advice="write one with `daylit doctor --write-rig rig.toml`, or try `--simulate room`")
