"""What every luminance meter can do, and the type of a reading."""

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Protocol, runtime_checkable


class ReadingStatus(StrEnum):
    """What a reading is worth. Only `OK` and `TYPED` carry a number."""

    OK = "ok"
    TYPED = "typed"
    """A person typed the number from the instrument's display."""
    OVER_RANGE = "over_range"
    UNDER_RANGE = "under_range"
    WRONG_UNIT = "wrong_unit"
    """The display is in fL or in per cent."""
    WRONG_MODE = "wrong_mode"
    """Peak, ratio or user calibration is on: the number is not a plain luminance."""
    BATTERY_LOW = "battery_low"
    FROZEN = "frozen"
    """The same digits came back too often to be a live measurement."""
    UNSTEADY = "unsteady"
    """Repeated readings spread more than the limit."""
    ERROR_CODE = "error_code"
    """The instrument answered with an error that has no status of its own."""
    GARBLED = "garbled"
    """The answer does not have the dialect's form (noise, joined or partial lines)."""
    NO_ANSWER = "no_answer"


@dataclass(frozen=True)
class MeterIdentity:
    """Who the meter is, as far as it says; `dialect_verified` is False for an assumed protocol."""

    model: str
    serial: str
    dialect: str
    dialect_verified: bool
    port: str


@dataclass(frozen=True)
class MeterReading:
    """One reading; ``luminance_cd_m2`` is None unless the status is OK or TYPED.

    ``raw`` is the last answer as it came (ASCII with escapes), ``spread_frac`` is (max - min) / mean of the
    ``n_samples`` readings it stands for, ``detail`` explains a status that is not OK.
    """

    status: ReadingStatus
    luminance_cd_m2: float | None
    raw: str
    taken_utc: datetime
    taken_monotonic_s: float
    dialect: str
    dialect_verified: bool
    n_samples: int = 1
    spread_frac: float = 0.0
    detail: str = ""

    def __post_init__(self) -> None:
        if (self.luminance_cd_m2 is not None) != (self.status in (ReadingStatus.OK, ReadingStatus.TYPED)):
            raise ValueError(f"a reading of status {self.status} with number {self.luminance_cd_m2}")


@runtime_checkable
class Meter(Protocol):
    """A luminance meter. Methods raise `drivers.errors.DeviceError` kinds only for a broken link;
    anything the instrument itself reports is a status of the reading.
    """

    kind: str

    def connect(self) -> MeterIdentity:
        """Open the link and check that a meter of this dialect answers."""

    def measure(self, *, n_samples: int = 1, timeout_s: float = 15.0) -> MeterReading:
        """Take ``n_samples`` readings and return their mean with its spread, or the status that spoils it."""

    def close(self) -> None:
        """Release the link; never raises."""
