"""Error numbers of libusb, as typed errors that say what to do."""

from __future__ import annotations

import errno

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
