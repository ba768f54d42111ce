"""Errors of daylit, as a tree; each says what happened, where, why it is likely, and what to do.

The classes below are the tree: `DaylitError`, then `DeviceError` (exit 3) and its kinds; docs/reference/errors.md lists
all of daylit with their codes.

``retryable`` says whether the same call may work later without a person doing anything.
"""

from typing import Any, ClassVar


class DaylitError(Exception):
    """Base of all errors that daylit raises on purpose.

    ``message``: what happened, in one sentence.
    ``where``: the instrument, file or step it happened in.
    ``likely``: the most likely cause.
    ``advice``: what to do next.
    ``details``: JSON-able facts for the journal (codes, lengths, bytes as hex).
    """

    code: ClassVar[str] = "DAY-000"
    exit_code: ClassVar[int] = 70
    retryable: ClassVar[bool] = False

    def __init_subclass__(cls, **facts: str | int | bool) -> None:
        """Take ``code``, ``exit_code`` and ``retryable`` from the line that names the class."""
        super().__init_subclass__()
        for name, value in facts.items():
            setattr(cls, name, value)

    def __init__(self, message: str, *, where: str = "", likely: str = "", advice: str = "", **details: Any) -> None:
        super().__init__(message)
        self.message = message
        self.where = where
        self.likely = likely
        self.advice = advice
        self.details = details

    def __str__(self) -> str:
        parts = [f"{self.where}: {self.message}" if self.where else self.message]
        if self.likely:
            parts.append(f"likely cause: {self.likely}")
        if self.advice:
            parts.append(f"what to do: {self.advice}")
        return " | ".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """Return the error as a JSON-able mapping (code, kind, message, where, likely, advice, details)."""
        named = ("message", "where", "likely", "advice", "retryable", "details")
        return {"code": self.code, "kind": type(self).__name__, **{name: getattr(self, name) for name in named}}


class DeviceError(DaylitError, code="DEV-000", exit_code=3):
    """Something is wrong with an instrument or with the link to it."""


class DeviceNotFoundError(DeviceError, code="DEV-001"):
    """The instrument is not there: not plugged in, switched off, or another model."""


class DeviceClaimedError(DeviceError, code="DEV-002"):
    """Another program holds the instrument; ``details['holder']`` names it where the system says."""


class DevicePermissionError(DeviceError, code="DEV-003"):
    """The operating system refuses access (udev rule or group membership missing)."""


class DeviceLostError(DeviceError, code="DEV-004"):
    """The instrument was there and is gone; the link must be opened anew."""


class DeviceTimeoutError(DeviceError, code="DEV-005", retryable=True):
    """No answer within the limit of the call."""


class DeviceBusyError(DeviceError, code="DEV-006", retryable=True):
    """The instrument answered "busy" until the limit of the call."""


class LinkStallError(DeviceError, code="DEV-007", retryable=True):
    """An endpoint is halted; the session layer clears it and retries once."""


class ProtocolViolationError(DeviceError, code="DEV-008"):
    """An answer that the protocol does not allow (``details``: expected, got)."""


class OperationRefusedError(DeviceError, code="DEV-009"):
    """A well-formed refusal; ``response_code`` is the instrument's own code."""

    def __init__(self, message: str, *, response_code: int, **kwargs: Any) -> None:
        super().__init__(message, response_code=response_code, **kwargs)
        self.response_code = response_code


class SettingRefusedError(DeviceError, code="DEV-010"):
    """A setting cannot be made, or reads back as something else (``details``: asked, got)."""


class StoreFullError(DeviceError, code="DEV-011"):
    """The instrument's own store is full, write-protected or missing."""


class BatteryLowError(DeviceError, code="DEV-012"):
    """Too little charge to finish a bracket."""


class ExposureFailedError(DeviceError, code="DEV-013", retryable=True):
    """The shutter was asked to open and no picture came."""


class UnsupportedError(DeviceError, code="DEV-014"):
    """The instrument cannot do what was asked."""
