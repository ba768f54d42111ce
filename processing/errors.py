"""Errors of processing. Exit codes: 5 a stage failed · 2 usage · 4 session · 6 resource (see `station.errors`)."""

from __future__ import annotations

from drivers.errors import DaylitError
from station.errors import UsageError


class ProcessingError(DaylitError):
    """A stage cannot give what it should."""

    code = "PRC-000"
    exit_code = 5


class ParameterError(UsageError):
    """A parameter or an option that cannot be right; names it and its range."""

    code = "USE-004"


class PictureFileError(ProcessingError):
    """A picture file that is damaged, of the wrong kind, or holds values that light cannot have; names the file."""

    code = "PIC-001"


class ResponseError(ProcessingError):
    """Frames from which no response curve can be told: too few, all alike, all clipped or all dark."""

    code = "CAL-001"


class BracketError(ProcessingError):
    """Frames that cannot be one bracket: sizes, types or exposures that do not fit together."""

    code = "CAL-002"


class ScaleError(ProcessingError):
    """No absolute scale: no usable meter reading, no target in the picture, or a target that is clipped or dark."""

    code = "CAL-003"


class ChartError(ProcessingError):
    """The chart was not found, or what was found is not the chart."""

    code = "CAL-004"


class ProfileError(ProcessingError):
    """A calibration profile that cannot be read, or belongs to another camera or to other settings."""

    code = "CAL-005"


class LensError(ProcessingError):
    """A lens model or an image circle that cannot be right."""

    code = "CAL-006"


class SunError(ProcessingError):
    """The sun was needed and was not found, or is where the time and the site say it cannot be."""

    code = "CAL-007"
