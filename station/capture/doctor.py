"""What `daylit doctor` looks at: the computer, the links, and (with a rig) every instrument."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from drivers.errors import DaylitError
from station.capture.preflight import Check, Level

RULES_NAME = "70-daylit.rules"
RULE_FOLDERS = (Path("/etc/udev/rules.d"), Path("/usr/lib/udev/rules.d"), Path("/lib/udev/rules.d"))
GRABBERS = ("gvfs-gphoto2-volume-monitor", "gvfsd-gphoto2", "gvfs-mtp-volume-monitor", "gvfsd-mtp")
"""Desktop services that claim a camera as soon as it is plugged in."""


def check_computer(folder: Path) -> Iterator[Check]:
    """Yield checks of Python, libraries, the USB library, permissions, grabbers, the disk, and the renderer."""
    yield Check(Level.OK, "python", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    yield from _check_libraries()
    yield _check_usb_library()
    if sys.platform.startswith("linux"):
        yield _check_udev()
        yield _check_serial_group()
        yield from _check_grabbers()
    yield _check_disk(folder)
    yield from _check_isolation()
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
        yield Check(
            Level.WARN, "serial ports", "none", "plug the meter in; on Linux it shows as /dev/ttyACM* or ttyUSB*"
        )
    for port in ports:
        description = "" if port.description == "n/a" else port.description
        yield Check(Level.OK, "serial port", f"{port.device} {description}".strip())


def _check_libraries() -> Iterator[Check]:
    for module in ("pydantic", "serial", "usb", "libusb_package", "cv2", "numpy", "PIL", "rich"):
        if importlib.util.find_spec(module) is None:
            yield Check(Level.FAIL, "library", f"{module} is not installed", "install daylit anew (make demo)")


def _check_usb_library() -> Check:

    from drivers.usb_link import real_backend

    backend = real_backend()
    if backend is None:
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
    import grp

    groups = {grp.getgrgid(g).gr_name for g in os.getgroups() if _group_exists(g)}
    if os.geteuid() == 0 or groups & {"dialout", "uucp"}:
        return Check(Level.OK, "serial access", "you may open serial ports")
    advice = "sudo usermod -aG dialout $USER, then log in anew (or install the udev rule)"
    return Check(Level.WARN, "serial access", "you are not in the group dialout", advice)


def _group_exists(gid: int) -> bool:
    import grp

    try:
        grp.getgrgid(gid)
    except KeyError:
        return False
    return True


def _check_grabbers() -> Iterator[Check]:
    for process in Path("/proc").glob("[0-9]*/comm"):
        try:
            name = process.read_text().strip()
        except OSError:
            continue
        # The kernel keeps 15 characters of a name.
        if any(g.startswith(name) for g in GRABBERS if len(name) >= 10):
            advice = f"stop it while you capture: kill {process.parent.name} (or: gio mount -s gphoto2)"
            yield Check(Level.WARN, "desktop", f"{name} runs and takes cameras for itself", advice)


def _check_disk(folder: Path) -> Check:
    existing = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    free_gb = shutil.disk_usage(existing).free / 1e9
    text = f"{free_gb:.1f} GB free for sessions (one takes about 0.15 GB)"
    if free_gb > 2:
        return Check(Level.OK, "disk", text)
    return Check(Level.WARN, "disk", text, "free some space, or choose another disk with --into")


def _check_isolation() -> Iterator[Check]:
    from station.frames.check import FrameChecker

    with FrameChecker() as checker:
        try:
            checker.start()
        except DaylitError as error:
            yield Check(Level.FAIL, "frame checker", error.message, error.advice, error)
            return
        yield Check(Level.OK, "frame checker", _limits_text(checker.limits))


def _check_renderer() -> Check:
    from station.capture.rig import simulated_renderer

    try:
        return Check(Level.OK, "renderer", simulated_renderer())
    except DaylitError as error:
        return Check(Level.WARN, "renderer", error.message, error.advice, error)


def _limits_text(limits: Sequence[str]) -> str:
    if not limits:
        return "works; runs without limits on this system"
    return f"works, confined ({'; '.join(limits)})"
