"""What the operating system says when a link fails, USB or serial, as typed errors that say what to do; and who
holds a device."""

import errno
import os
from contextlib import suppress
from pathlib import Path

from drivers import errors

COMES_BACK = (
    errors.DeviceLostError,
    errors.DeviceNotFoundError,
    errors.DevicePermissionError,
    errors.DeviceClaimedError,
)
"""Of a port that was put back a moment ago: not there yet, without its permissions, or probed by a service."""


def typed_error(number: int | None, message: str, where: str) -> errors.DeviceError:
    """Return our error for an error number (``errno``) that a USB call ended with."""
    if number in (errno.ETIMEDOUT, errno.EAGAIN):
        return errors.DeviceTimeoutError(message, where=where, errno=number)
    if number == errno.EPIPE:
        return errors.LinkStallError(message, where=where, errno=number)
    if number == errno.EOVERFLOW:
        likely = "the camera sent more than a packet"
        return errors.ProtocolViolationError(message, where=where, likely=likely, errno=number)
    if number in (errno.EACCES, errno.EPERM):
        likely = "no udev rule grants you access"
        advice = "install drivers/udev/70-daylit.rules, then replug the camera"
        return errors.DevicePermissionError(message, where=where, likely=likely, advice=advice, errno=number)
    # EIO is what Linux gives while a cable is being pulled; only opening the link anew helps against any of the rest.
    likely = "the cable was pulled or the camera switched off"
    advice = "check cable and power, then resume"
    return errors.DeviceLostError(message, where=where, likely=likely, advice=advice, errno=number)


def open_error(error: Exception, name: str) -> errors.DeviceError:
    """Return what it means that the port ``name`` does not open."""
    number, text = getattr(error, "errno", None), str(error)
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        holder = find_holder(name)
        text = f"{holder or 'another program'} holds the port"
        advice = f"stop {holder or 'it'} (ModemManager? see the udev rule)"
        return errors.DeviceClaimedError(text, where=name, advice=advice, holder=holder)
    if number in (errno.EACCES, errno.EPERM):
        advice = "install the udev rule, or join the group dialout and log in again"
        return errors.DevicePermissionError("the system refuses the port", where=name, advice=advice)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "could not open port" in text or "ioctl" in text:
        return errors.DeviceNotFoundError("no such port", where=name, advice="daylit doctor lists the ports")
    return errors.DeviceLostError(f"the port does not open: {text}", where=name, advice="plug it in again")


PROC = Path("/proc")
GRABBERS = ("gvfs-gphoto2-volume-monitor", "gvfsd-gphoto2", "gvfs-mtp-volume-monitor", "gvfsd-mtp")
"""Desktop services that claim a camera as soon as it is plugged in."""
SUSPECTS = (*GRABBERS, "gphoto2", "kiod5")  # programs that are known to claim cameras by themselves
COMM_CHARACTERS = 15  # the kernel cuts the name of a process after as many (Linux, TASK_COMM_LEN less its NUL)


def find_holder(node: str, proc: Path = PROC, *, suspects: tuple[str, ...] = ()) -> str:
    """Return who has a device node open, as ``name (pid 17)``; a running suspect as ``perhaps ...``; else "".

    Linux shows it by the open files of processes, of other users' only to root: then only suspicion is left.
    Elsewhere nobody is named.
    """
    target, perhaps = os.path.realpath(node), ""
    others = (path for path in proc.glob("[0-9]*") if path.name != str(os.getpid()))
    for process in sorted(others, key=lambda path: int(path.name)):
        name = process_name(process)
        if _has_open(process, target):
            return f"{name} (pid {process.name})"
        if not perhaps and name in {suspect[:COMM_CHARACTERS] for suspect in suspects}:
            perhaps = f"perhaps {name} (pid {process.name})"
    return perhaps


def process_name(process: Path) -> str:
    """Return the name of a process (of its folder under /proc), at most `COMM_CHARACTERS` of it."""
    with suppress(OSError):
        return (process / "comm").read_text("utf-8", "replace").strip()
    return "a process that has ended"


def _has_open(process: Path, target: str) -> bool:
    with suppress(OSError):
        return any(os.path.realpath(entry) == target for entry in (process / "fd").iterdir())
    return False
