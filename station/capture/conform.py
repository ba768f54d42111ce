"""The conformance suite: what every camera and every meter must do, run on simulated and on real instruments alike.

Each check is a function that gets the instrument and returns what it saw in words; it raises `NonConformance`, or
whatever the driver raised, when the contract of `drivers.camera` or `drivers.meter.interface` is broken. On a real
camera the suite takes pictures; it deletes only pictures that it took, and only where that is allowed.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

from drivers.camera import Camera, CameraSettings, ExposureProgress, FrameFormat, FrameRef, Verdict
from drivers.clock import Clock, Deadline
from drivers.errors import DeviceBusyError, DeviceError, SettingRefusedError, UnsupportedError
from drivers.meter.interface import Meter, ReadingStatus
from station.capture.bracket import PAPER_STOPS_S
from station.capture.camera_worker import EXPOSURE_GRACE_S
from station.session.session import shutter_label

# Chosen: long, usual and short.
PICTURE_STOPS_S = (1 / 4, 1 / 60, 1 / 1000)
POLL_LIMIT_S = 1.0  # a poll may take about 50 ms; ten times that and more is a camera that blocks its thread


class NonConformance(AssertionError):
    """The instrument, or its driver, does not do what the contract says."""


@dataclass(frozen=True)
class Outcome:
    """Result of one check."""

    instrument: str
    name: str
    passed: bool
    detail: str


@dataclass
class CameraBench:
    """A camera under test, and what the checks learn about it."""

    camera: Camera
    settings: CameraSettings
    clock: Clock
    may_delete: bool = False
    frames: list[FrameRef] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)

    def shoot(self, shutter_s: float) -> tuple[FrameRef, ...]:
        """Take one picture and return its frames; those that the camera still holds in its memory are let go before."""
        for held in [f for f in self.frames if not f.storage_id]:
            self.fetch(held)
            self.camera.finish_frame(held)
            self.frames.remove(held)
        shutter = self.camera.set_shutter(shutter_s)
        self.camera.arm()
        start_s = self.clock.monotonic_s()
        self.camera.release()
        self.figures["release_call_s"] = self.clock.monotonic_s() - start_s
        progress = self._wait(shutter.nominal_s)
        self.figures["overhead_s"] = self.clock.monotonic_s() - start_s - shutter.nominal_s
        self.frames += progress.frames
        return progress.frames

    def _wait(self, shutter_s: float) -> ExposureProgress:
        deadline = Deadline.after(self.clock, 2 * shutter_s + EXPOSURE_GRACE_S)
        while True:
            start_s = self.clock.monotonic_s()
            progress = self.camera.poll_exposure()
            took_s = self.clock.monotonic_s() - start_s
            expect(took_s < POLL_LIMIT_S, f"poll_exposure blocked for {took_s:.2f} s")
            if progress.done:
                return progress
            deadline.check("picture", "conform")

    def fetch(self, frame: FrameRef, chunk_bytes: int = 1 << 20) -> bytes:
        """Return the whole frame, read in chunks."""
        data = bytearray()
        deadline = Deadline.after(self.clock, 120.0)
        while len(data) < frame.size_bytes:
            deadline.check("frame", "conform")
            try:
                data += self.camera.read_chunk(frame, len(data), min(chunk_bytes, frame.size_bytes - len(data)))
            except DeviceBusyError:
                self.clock.sleep(0.05)
        return bytes(data)


def expect(condition: bool, message: str) -> None:
    """Raise `NonConformance` with the message unless the condition holds."""
    if not condition:
        raise NonConformance(message)


def run_camera(bench: CameraBench) -> Iterator[Outcome]:
    """Run all camera checks in order; yields each outcome as it comes; leaves the camera closed."""
    return _run(bench.camera, CAMERA_CHECKS, bench)


def run_meter(meter: Meter, clock: Clock) -> Iterator[Outcome]:
    """Run all meter checks in order; yields each outcome as it comes; leaves the meter closed."""
    return _run(meter, METER_CHECKS, meter, clock)


def _run(instrument: Camera | Meter, checks: Iterable[Callable[..., str]], *given: object) -> Iterator[Outcome]:
    for check in checks:
        try:
            yield Outcome(instrument.kind, check.__name__, passed=True, detail=check(*given))
        except (NonConformance, DeviceError) as error:
            yield Outcome(instrument.kind, check.__name__, passed=False, detail=f"{type(error).__name__}: {error}")
    instrument.close()


def says_who_it_is(bench: CameraBench) -> str:
    """Connect, twice with a close in between, gives one and the same identity."""
    first = bench.camera.connect()
    bench.camera.close()
    bench.camera.close()
    second = bench.camera.connect()
    expect(first == second, f"{first} became {second}")
    expect(bool(first.model and first.serial), "model or serial number is empty")
    return f"{first.manufacturer} {first.model}, serial {first.serial}, firmware {first.firmware}"


def reports_its_state(bench: CameraBench) -> str:
    """Battery, space and clock are plausible where reported."""
    status = bench.camera.status()
    expect(status.battery_frac is None or 0 <= status.battery_frac <= 1, f"battery {status.battery_frac}")
    expect(status.free_bytes is None or status.free_bytes >= 0, f"free {status.free_bytes} bytes")
    expect(status.clock_utc is None or status.clock_utc.tzinfo is not None, "its clock has no time zone")
    expect(status.ready == (not status.problems), f"ready is {status.ready} with problems {status.problems}")
    return f"battery {status.battery_frac}, free frames {status.free_frames}, problems {list(status.problems)}"


def takes_and_reads_back_settings(bench: CameraBench) -> str:
    """Every fixed setting is read back, and ISO, f-number and size are taken exactly."""
    settings = bench.camera.prepare(bench.settings)
    names = {s.name for s in settings}
    expect(len(names) >= 4, f"only {sorted(names)} are read back")
    refused = [f"{s.name}: asked {s.asked}, got {s.got}" for s in settings if not s.honoured]
    return f"{len(settings)} settings read back" + (f"; not exact: {refused}" if refused else "")


def reports_its_body(bench: CameraBench) -> str:
    """The settings of the body that no rig file sets are judged, each with a reason where it is changed or refused."""
    body = bench.camera.body_settings()
    expect(all(s.reason for s in body if s.verdict in (Verdict.SET, Verdict.REFUSED)), "a verdict without a reason")
    return "; ".join(f"{s.name} {s.got} ({s.verdict})" for s in body)


def refuses_impossible_settings(bench: CameraBench) -> str:
    """A setting that the camera does not have is refused by name, and the camera still works."""
    try:
        bench.camera.prepare(replace(bench.settings, iso=31, keep_raw=False))
    except (SettingRefusedError, UnsupportedError) as error:
        bench.camera.prepare(bench.settings)
        return error.message
    raise NonConformance("ISO 31 was accepted")


def has_the_bracket(bench: CameraBench) -> str:
    """Each stop of the paper's bracket, and one in between, gives the nearest time the camera has."""
    times_s = bench.camera.shutter_times_s
    expect(list(times_s) == sorted(times_s, reverse=True) and len(times_s) > 8, "times are not sorted, longest first")
    inexact = []
    for asked_s in (*PAPER_STOPS_S, 1 / 17):
        got_s = bench.camera.set_shutter(asked_s).nominal_s
        nearest_s = min(times_s, key=lambda t: abs(math.log(t / asked_s)))
        expect(math.isclose(got_s, nearest_s, rel_tol=1e-9), f"asked {asked_s}, set {got_s}, nearest is {nearest_s}")
        if not math.isclose(got_s, asked_s, rel_tol=1e-6):
            inexact.append(f"{shutter_label(asked_s)} → {shutter_label(got_s)}")
    return f"{len(times_s)} times; nearest taken for {inexact}"


def takes_pictures(bench: CameraBench) -> str:
    """Each release gives exactly one JPEG (and one raw where asked), announced in time."""
    handles: list[int] = []
    for shutter_s in PICTURE_STOPS_S:
        frames = bench.shoot(shutter_s)
        formats = sorted(f.format.value for f in frames)
        n_expected = 2 if bench.settings.keep_raw else 1
        expect(len(frames) == n_expected and "jpeg" in formats, f"{shutter_label(shutter_s)}: frames {formats}")
        expect(all(f.size_bytes > 0 for f in frames), "a frame of no bytes")
        handles += [f.handle for f in frames]
    expect(len(set(handles)) == len(handles), f"a handle came twice: {handles}")
    return f"{len(handles)} frames, overhead {bench.figures['overhead_s']:.2f} s beside the exposure"


def gives_the_same_bytes_in_any_chunks(bench: CameraBench) -> str:
    """A frame read in large and in odd small chunks is the same, and is a whole JPEG."""
    frame = next((f for f in bench.frames[::-1] if f.format is FrameFormat.JPEG), None)
    if frame is None:
        raise NonConformance("there is no JPEG to read")
    start_s = bench.clock.monotonic_s()
    large = bench.fetch(frame)
    bench.figures["rate_bytes_s"] = len(large) / max(bench.clock.monotonic_s() - start_s, 1e-9)
    expect(large == bench.fetch(frame, max(len(large) // 7 - 3, 1)), "large and small chunks differ")
    expect(large[:2] == b"\xff\xd8" and large[-2:] == b"\xff\xd9", "it is not a whole JPEG")
    for taken in bench.frames:
        bench.camera.finish_frame(taken)
    bench.frames = [f for f in bench.frames if f.storage_id]
    return f"{len(large)} bytes at {bench.figures['rate_bytes_s'] / 1e6:.1f} MB/s"


def transfers_while_exposing_or_says_busy(bench: CameraBench) -> str:
    """A read during an exposure gives bytes or "busy"; neither spoils the exposure."""
    earlier = bench.shoot(1 / 60)[0]
    if not earlier.storage_id:
        return "skipped: the camera holds its pictures, and is busy until they are fetched"
    bench.camera.set_shutter(1.0)
    bench.camera.arm()
    bench.camera.release()
    got, busy, progress = 0, 0, ExposureProgress(done=False)
    deadline = Deadline.after(bench.clock, EXPOSURE_GRACE_S)
    while not progress.done:
        deadline.check("picture", "conform")
        try:
            if bench.camera.can_transfer_while_exposing and got < earlier.size_bytes:
                got += len(bench.camera.read_chunk(earlier, got, min(1 << 18, earlier.size_bytes - got)))
        except DeviceBusyError:
            busy += 1
        progress = bench.camera.poll_exposure()
    bench.frames += progress.frames
    expect(len(progress.frames) >= 1, "the exposure gave no picture")
    for frame in (earlier, *progress.frames):
        bench.camera.finish_frame(frame)
    return f"{got} bytes meanwhile" if got else f"says busy ({busy} times): transfers wait for the exposure"


def recovers(bench: CameraBench) -> str:
    """`recover` on a healthy camera, and a new `prepare`, leave it able to take a picture."""
    bench.camera.recover()
    bench.camera.prepare(bench.settings)
    frames = bench.shoot(1 / 60)
    for frame in frames:
        bench.fetch(frame)
        bench.camera.finish_frame(frame)
    bench.frames = [f for f in bench.frames if f.storage_id]
    expect(len(frames) >= 1, "no picture after recover")
    return "takes pictures after recover"


def deletes_what_is_asked(bench: CameraBench) -> str:
    """A deleted frame is gone, the others stay; skipped where deleting is not allowed."""
    if not bench.may_delete:
        return "skipped: deleting is not allowed (--delete)"
    listed = {f.handle for f in bench.camera.list_frames()}
    if not bench.frames:
        return "skipped: the camera keeps none of its pictures"
    mine = [f for f in bench.frames if f.handle in listed]
    expect(bool(mine), "none of the pictures taken is listed")
    for frame in mine:
        bench.camera.delete(frame)
    left = {f.handle for f in bench.camera.list_frames()}
    expect(left == listed - {f.handle for f in mine}, "the list after deleting is not what it should be")
    return f"{len(mine)} deleted, {len(left)} left"


def closes_quietly(bench: CameraBench) -> str:
    """`close` twice is harmless, and the camera can be opened again."""
    bench.camera.keep_alive()
    bench.camera.close()
    bench.camera.close()
    bench.camera.connect()
    return "closed, closed again, opened again"


CAMERA_CHECKS: tuple[Callable[[CameraBench], str], ...] = (
    says_who_it_is,
    reports_its_state,
    takes_and_reads_back_settings,
    reports_its_body,
    refuses_impossible_settings,
    has_the_bracket,
    takes_pictures,
    gives_the_same_bytes_in_any_chunks,
    transfers_while_exposing_or_says_busy,
    recovers,
    deletes_what_is_asked,
    closes_quietly,
)


def meter_says_who_it_is(meter: Meter, clock: Clock) -> str:
    """Connect, twice with a close in between, gives one and the same identity."""
    first = meter.connect()
    meter.close()
    meter.close()
    second = meter.connect()
    expect(first == second, f"{first} became {second}")
    verified = "verified" if first.dialect_verified else "ASSUMED, not verified"
    return f"{first.model} {first.serial} on {first.port}, dialect {first.dialect} ({verified})"


def meter_reads(meter: Meter, clock: Clock) -> str:
    """A reading has a number exactly when its status is ok, in time, and is dated."""
    start_s = clock.monotonic_s()
    reading = meter.measure(timeout_s=15.0)
    took_s = clock.monotonic_s() - start_s
    expect(took_s < 20.0, f"took {took_s:.1f} s with a limit of 15 s")
    expect(reading.taken_utc.tzinfo is not None, "the reading's time has no zone")
    expect(reading.status is ReadingStatus.OK, f"status {reading.status}: {reading.detail} ({reading.raw})")
    return f"{reading.luminance_cd_m2:g} cd/m2 in {took_s:.1f} s, raw {reading.raw!r}"


def meter_averages(meter: Meter, clock: Clock) -> str:
    """Three samples give their mean and a spread below 20 per cent (point it at a steady surface)."""
    reading = meter.measure(n_samples=3, timeout_s=30.0)
    expect(reading.status is ReadingStatus.OK, f"status {reading.status}: {reading.detail}")
    expect(reading.n_samples == 3, f"{reading.n_samples} samples instead of 3")
    expect(0 <= reading.spread_frac < 0.2, f"spread {reading.spread_frac:.0%}")
    return f"{reading.luminance_cd_m2:g} cd/m2, spread {reading.spread_frac:.2%}"


METER_CHECKS: tuple[Callable[[Meter, Clock], str], ...] = (meter_says_who_it_is, meter_reads, meter_averages)
