"""Error numbers of libusb, as typed errors that say what to do."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from drivers.errors import (
    DeviceError,
    DeviceLostError,
    DevicePermissionError,
    DeviceTimeoutError,
    LinkStallError,
    ProtocolViolationError,
)


def typed_error(number: int | None, message: str, where: str) -> DeviceError:
    """Return our error for an error number (``errno``) that a USB call ended with."""
    if number in (errno.ETIMEDOUT, errno.EAGAIN):
        return DeviceTimeoutError(message, where=where, errno=number)
    if number == errno.EPIPE:
        return LinkStallError(message, where=where, errno=number)
    if number == errno.EOVERFLOW:
        return ProtocolViolationError(message, where=where, likely="the camera sent more than a packet", errno=number)
    if number in (errno.EACCES, errno.EPERM):
        return DevicePermissionError(
            message,
            where=where,
            likely="no udev rule gives you the camera",
            advice="install drivers/udev/70-daylit.rules, then replug the camera",
            errno=number,
        )
    # EIO is what Linux gives while a cable is being pulled; only opening the link anew helps against any of the rest.
    return DeviceLostError(
        message,
        where=where,
        likely="the cable was pulled or the camera switched off",
        advice="check cable and power, then resume",
        errno=number,
    )


# Who holds a USB device: Linux tells by the open files of processes; elsewhere nobody is named.


SUSPECTS = ("gvfs-gphoto2-volume-monitor", "gvfsd-gphoto2", "gvfs-mtp-volume-monitor", "gvfsd-mtp", "gphoto2", "kiod5")
"""Programs that are known to claim cameras by themselves."""
COMM_CHARACTERS = 15
"""The kernel cuts the name of a process after as many."""


def find_holder(bus: int, address: int, proc: Path = Path("/proc")) -> str:
    """Return who has the device open, as ``name (process id)``; a running suspect as ``perhaps ...``; else "".

    Processes of other users do not show what they have open; then only suspicion is left.
    """
    node = f"/dev/bus/usb/{bus:03d}/{address:03d}"
    perhaps = ""
    for process in _processes(proc):
        name = _name(process)
        if _has_open(process, node):
            return f"{name} ({process.name})"
        if not perhaps and name in {suspect[:COMM_CHARACTERS] for suspect in SUSPECTS}:
            perhaps = f"perhaps {name} ({process.name})"
    return perhaps


def _processes(proc: Path) -> list[Path]:
    try:
        found = [path for path in proc.iterdir() if path.name.isdigit() and path.name != str(os.getpid())]
    except OSError:
        return []
    return sorted(found, key=lambda path: int(path.name))


def _name(process: Path) -> str:
    try:
        return (process / "comm").read_text("utf-8", "replace").strip()
    except OSError:
        return "a process that has ended"


def _has_open(process: Path, node: str) -> bool:
    try:
        return any(str(entry.readlink()) == node for entry in (process / "fd").iterdir())
    except OSError:
        return False
