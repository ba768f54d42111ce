"""What the operating system says about a serial port, as our errors; and who holds the port."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from drivers.errors import (
    DeviceClaimedError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
)

PROC = Path("/proc")


def open_error(error: Exception, name: str) -> DeviceError:
    """Return what it means that the port ``name`` does not open."""
    number = getattr(error, "errno", None)
    text = str(error)
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        holder = find_holder(name)
        return DeviceClaimedError(
            f"{holder or 'another program'} holds the port",
            where=name,
            advice=f"stop {holder or 'it'} (ModemManager? see the udev rule)",
            holder=holder,
        )
    if number in (errno.EACCES, errno.EPERM):
        advice = "install the udev rule, or join the group dialout and log in anew"
        return DevicePermissionError("the system refuses the port", where=name, advice=advice)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "could not open port" in text:
        return DeviceNotFoundError("there is no such port", where=name, advice="daylit doctor lists the ports")
    return DeviceLostError(f"the port does not open: {text}", where=name, advice="plug it in anew")


def find_holder(name: str, proc: Path = PROC) -> str:
    """Return the program that has the device open as "name (pid n)", where the system tells ("" otherwise)."""
    target = os.path.realpath(name)
    for link in proc.glob("[0-9]*/fd/*"):
        process = link.parents[1]
        try:
            if os.path.realpath(link) == target and process.name != str(os.getpid()):
                return f"{(process / 'comm').read_text().strip()} (pid {process.name})"
        except OSError:
            continue
    return ""
