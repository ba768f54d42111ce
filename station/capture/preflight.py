"""Before the first picture: what would spoil a bracket. `check_rig` connects, sets and reads back every instrument;
what `daylit doctor` looks at besides (the computer, the links) follows below."""

import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, get_args

from drivers.camera import NOT_REPORTED, BodySetting, Camera, CameraStatus, SettingReadback, Verdict
from drivers.clock import Clock
from drivers.errors import DaylitError, DeviceError
from drivers.link_errors import COMM_CHARACTERS, GRABBERS, PROC, process_name
from station.capture.rig import Rig
from station.capture.rig_file import Accepted, LimitsTable
from station.session.session import DeviceRecord, SettingRecord, Side

SESSION_BYTES = 150_000_000  # chosen: the JPEGs of a bracket of nine
RULES_NAME = "70-daylit.rules"
RULE_FOLDERS = (Path("/etc/udev/rules.d"), Path("/usr/lib/udev/rules.d"), Path("/lib/udev/rules.d"))


class Level(StrEnum):
    """How bad a finding is."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


@dataclass(frozen=True)
class Check:
    """One finding of preflight or doctor."""

    level: Level
    name: str
    text: str
    advice: str = ""
    error: DaylitError | None = None

    def to_dict(self) -> dict[str, str]:
        """Return level, name, text and advice, and the error's code where it is one."""
        found = {"level": str(self.level), "name": self.name, "text": self.text, "advice": self.advice}
        return found if self.error is None else found | {"code": self.error.code}


@dataclass(frozen=True)
class Findings:
    """All checks of a rig, and the devices as they are to be recorded."""

    checks: tuple[Check, ...]
    devices: tuple[DeviceRecord, ...]


class PreflightError(DeviceError, code="DEV-020"):
    """Something would spoil the bracket; the message lists all of it at once."""


def check_rig(
    rig: Rig, folder: Path, *, bytes_needed: int, n_stops: int = 0, on_meter_ready: Callable[[], None] = lambda: None
) -> Findings:
    """Connect and set every instrument, in parallel, and report all findings together (never raises for a device).

    ``n_stops``: of the bracket that the cards need room for, with its raw files; 0: the rig file's.
    ``on_meter_ready`` is called, in another thread, as soon as the meter answers: cameras take longer to set.
    """
    jobs: list[Callable[[], Findings]] = [
        lambda side=side, camera=camera: _check_camera(side, camera, rig, n_stops)  # type: ignore[misc]
        for side, camera in rig.cameras.items()
    ]
    if rig.meter is not None:
        jobs.append(lambda: _check_meter(rig, on_meter_ready))
    with ThreadPoolExecutor(max_workers=max(1, len(jobs))) as pool:
        found = list(pool.map(lambda job: job(), jobs))
    checks = [c for f in found for c in f.checks]
    checks.append(check_disk(folder, rig.file.limits, bytes_needed))
    return Findings(tuple(checks), tuple(d for f in found for d in f.devices))


def require(findings: Findings) -> None:
    """Raise `PreflightError` naming every failed check; a single device error is raised as itself."""
    failures = [c for c in findings.checks if c.level is Level.FAIL]
    if not failures:
        return
    if len(failures) == 1 and failures[0].error is not None:
        raise failures[0].error
    text = "; ".join(f"{c.name}: {c.text}" for c in failures)
    advice = "; ".join(dict.fromkeys(c.advice for c in failures if c.advice)) or "see daylit doctor"
    raise PreflightError(text, where="preflight", advice=advice, checks=[c.to_dict() for c in failures])


def check_disk(folder: Path, limits: LimitsTable, bytes_needed: int) -> Check:
    """Check that sessions can be put into the folder, and its disk has room for one and the margin of the rig file."""
    seen = next(p for p in (folder, *folder.absolute().parents) if os.path.lexists(p))  # see make_folders
    ours = os.access in os.supports_effective_ids
    if not (os.path.isdir(seen) and os.access(seen, os.W_OK | os.X_OK, effective_ids=ours)):  # noqa: PTH112 (as there)
        text = f"{seen} is not a folder that can be written to"
        return Check(Level.FAIL, "disk", text, advice="choose another folder with --into, or permit writing")
    free = shutil.disk_usage(seen).free
    needed = bytes_needed + int(limits.min_free_disk_mb * 1e6)
    text = f"{free / 1e9:.1f} GB free, {needed / 1e9:.1f} GB needed with margin"
    if free >= needed:
        return Check(Level.OK, "disk", text)
    return Check(Level.FAIL, "disk", text, advice="free some space or choose another folder with --into")


def _check_camera(side: Side, camera: Camera, rig: Rig, n_stops: int) -> Findings:
    table = rig.file.cameras()[side]
    frames = (n_stops or len(rig.file.bracket.stops)) * (1 + table.keep_raw)
    try:
        identity = camera.connect()
        settings = camera.prepare(table.settings())
        body = camera.body_settings()
        status = camera.status()
    except DaylitError as error:
        return Findings((Check(Level.FAIL, str(side), error.message, error.advice, error),), ())
    offset_s = clock_offset_s(status, rig.clock)
    said = (
        ("battery {:.0%}", status.battery_frac),
        ("room for {} frames", status.free_frames),
        ("clock {:+.1f} s", offset_s),
    )
    unlike = [s for s in settings if not s.honoured]
    reported = "".join(f"; {words.format(value)}" for words, value in said if value is not None)
    checks = [
        Check(Level.OK, str(side), f"{identity.model} {identity.serial} (firmware {identity.firmware}){reported}"),
        *[Check(Level.WARN, f"{side} {s.name}", f"asked {s.asked}, the camera has {s.got}") for s in unlike],
        *_body_checks(side, body, table.accept),
        *status_checks(side, status, offset_s, rig.file.limits, frames),
    ]
    record: dict[str, Any] = {"role": side.value, "kind": table.kind, "lens": table.lens, "nd_filter": table.nd_filter}
    record |= {name: getattr(identity, name)[:200] for name in ("manufacturer", "model", "serial", "firmware")}
    read = (*settings, *map(_kept, body))
    kept = tuple(SettingRecord(name=s.name, asked=s.asked[:500], got=s.got[:500], raw=s.raw[:500]) for s in read)
    device = DeviceRecord(**record, simulated=rig.simulated, clock_offset_s=offset_s, settings=kept)
    return Findings(tuple(checks), (device,))


def clock_offset_s(status: CameraStatus, clock: Clock) -> float | None:
    """Return the camera's clock minus ours, in seconds, where it reports its time."""
    return None if status.clock_utc is None else (status.clock_utc - clock.utc_now()).total_seconds()


def _body_checks(side: Side, body: Sequence[BodySetting], accepted: Sequence[str]) -> Iterator[Check]:
    """Yield what the body's own settings do to a bracket: refusals, what was changed, what nobody can see from here."""
    for setting in body:
        name, text = f"{side} {setting.name}", f"{setting.got}: {setting.reason}"
        if setting.verdict is Verdict.REFUSED and setting.name not in accepted:
            accept = f', or accept it in the rig file: accept = ["{setting.name}"]'
            advice = "change it on the camera" + (accept if setting.name in get_args(Accepted) else "")
            yield Check(Level.FAIL, name, text, advice)
        elif setting.reason:
            yield Check(Level.WARN, name, text)
    if unseen := [s.name for s in body if s.got == NOT_REPORTED]:
        text = f"the camera does not report: {', '.join(unseen)}"
        yield Check(Level.WARN, f"{side} settings", text, "check them on the camera (docs/guides/hardware.md)")


def _kept(setting: BodySetting) -> SettingReadback:
    """Return a setting of the body as the session keeps it: nothing was asked but where it was set."""
    asked = setting.got if setting.verdict is Verdict.SET else ""
    return SettingReadback(setting.name, asked, setting.got, setting.raw)


def status_checks(
    side: Side, status: CameraStatus, offset_s: float | None, limits: LimitsTable, frames: int
) -> list[Check]:
    """Return what a camera's state forbids or warns of, with room for ``frames`` pictures asked for."""
    checks = [
        Check(Level.FAIL, str(side), problem, advice=f"correct this on the camera: {problem}")
        for problem in status.problems
    ]
    checks += [Check(Level.WARN, str(side), warning) for warning in status.warnings]
    if status.battery_frac is not None and status.battery_frac < limits.min_battery_frac:
        text = f"battery at {status.battery_frac:.0%}, the limit is {limits.min_battery_frac:.0%}"
        checks.append(Check(Level.FAIL, f"{side} battery", text, advice="charge or replace the battery"))
    if status.free_frames is not None and status.free_frames < frames:
        text = f"room for {status.free_frames} frames on the card, {frames} needed"
        checks.append(Check(Level.FAIL, f"{side} card", text, advice="replace or empty it, or set delete_after"))
    if offset_s is not None and abs(offset_s) > limits.max_clock_skew_s:
        text = f"its clock is off by {offset_s:+.0f} s from the computer's clock"
        checks.append(Check(Level.WARN, f"{side} clock", text, advice="set the camera's clock"))
    return checks


def _check_meter(rig: Rig, on_ready: Callable[[], None]) -> Findings:
    assert rig.meter is not None
    try:
        identity = rig.meter.connect()
    except DaylitError as error:
        return Findings((Check(Level.FAIL, "meter", error.message, error.advice, error),), ())
    on_ready()
    checks = [Check(Level.OK, "meter", f"{identity.model} on {identity.port}, dialect {identity.dialect}")]
    if not identity.dialect_verified:
        text = f"dialect {identity.dialect} is ASSUMED: not yet confirmed on the instrument"
        checks.append(Check(Level.WARN, "meter", text, advice="send us a transcript: daylit meter probe"))
    device = DeviceRecord(
        role="meter",
        kind=rig.meter.kind,
        model=identity.model[:200],
        serial=identity.serial[:200],
        simulated=rig.simulated,
        dialect=identity.dialect,
        dialect_verified=identity.dialect_verified,
    )
    return Findings(tuple(checks), (device,))


def check_computer(folder: Path) -> Iterator[Check]:
    """Yield checks of Python, libraries, the USB library, permissions, grabbers, the disk, and the renderer."""
    yield Check(Level.OK, "python", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    for module in ("pydantic", "serial", "usb", "libusb_package", "cv2", "numpy", "PIL", "rich"):
        if importlib.util.find_spec(module) is None:
            yield Check(Level.FAIL, "library", f"{module} is not installed", "reinstall daylit (make demo)")
    yield _check_usb_library()
    if sys.platform.startswith("linux"):
        yield _check_udev()
        yield _check_serial_group()
        for process in PROC.glob("[0-9]*"):
            if (name := process_name(process)) in {grabber[:COMM_CHARACTERS] for grabber in GRABBERS}:
                advice = f"stop it while you capture: kill {process.name} (or: gio mount -s gphoto2)"
                yield Check(Level.WARN, "desktop", f"{name} is running and claims cameras", advice)
    yield check_disk(folder, LimitsTable(), SESSION_BYTES)
    yield _check_isolation()
    yield _check_renderer()


def list_instruments() -> Iterator[Check]:
    """Yield what is plugged in: known cameras on USB and serial ports."""
    from drivers.serial_link import list_ports
    from drivers.usb_link import list_cameras

    try:
        cameras = list_cameras()
    except DaylitError as error:
        cameras = []
        yield Check(Level.WARN, "cameras", error.message, error.advice, error)
    if not cameras:
        yield Check(Level.WARN, "cameras", "no PTP camera on USB", "plug it in, switch it on, wake it")
    for camera in cameras:
        ids = f"{camera.vendor_id:04x}:{camera.product_id:04x}"
        yield Check(Level.OK, "camera", f"{camera.product or 'unnamed'} ({ids}) on bus {camera.bus}.{camera.address}")
    ports = list_ports()
    if not ports:
        advice = "plug the meter in; on Linux it shows as /dev/ttyACM* or ttyUSB*"
        yield Check(Level.WARN, "serial ports", "none", advice)
    for port in ports:
        description = "" if port.description == "n/a" else port.description
        yield Check(Level.OK, "serial port", f"{port.device} {description}".strip())


def _check_usb_library() -> Check:
    from drivers.usb_link import real_backend

    if real_backend() is None:
        return Check(Level.FAIL, "libusb", "no USB library can be loaded", "pip install libusb-package")
    return Check(Level.OK, "libusb", "loaded")


def _check_udev() -> Check:
    if os.geteuid() == 0:
        return Check(Level.OK, "udev", "running as root: no rule needed")
    if any((folder / RULES_NAME).exists() for folder in RULE_FOLDERS):
        return Check(Level.OK, "udev", f"{RULES_NAME} is installed")
    source = Path(__file__).resolve().parents[2] / "drivers" / "udev" / RULES_NAME
    advice = f"sudo cp {source} /etc/udev/rules.d/ && sudo udevadm control --reload && replug the cameras"
    return Check(Level.WARN, "udev", f"{RULES_NAME} is not installed: cameras and meter may be refused", advice)


def _check_serial_group() -> Check:
    if os.geteuid() == 0 or _in_group("dialout") or _in_group("uucp"):
        return Check(Level.OK, "serial access", "you have access to serial ports")
    advice = "sudo usermod -aG dialout $USER, then log in again (or install the udev rule)"
    return Check(Level.WARN, "serial access", "you are not in the group dialout", advice)


def _in_group(name: str) -> bool:
    import grp

    try:
        return grp.getgrnam(name).gr_gid in os.getgroups()
    except KeyError:
        return False


def _check_isolation() -> Check:
    from station.frames.check import FrameChecker

    with FrameChecker() as checker:
        try:
            checker.start()
        except DaylitError as error:
            return Check(Level.FAIL, "frame checker", error.message, error.advice, error)
    limits = f", confined ({'; '.join(checker.limits)})" if checker.limits else "; not sandboxed on this system"
    return Check(Level.OK, "frame checker", f"works{limits}")


def _check_renderer() -> Check:
    from station.capture.rig import simulated_renderer

    try:
        return Check(Level.OK, "renderer", simulated_renderer())
    except DaylitError as error:
        return Check(Level.WARN, "renderer", error.message, error.advice, error)
