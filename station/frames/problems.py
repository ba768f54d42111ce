"""Why a file cannot be the frame that was asked for; apart from the session's models, which the worker does without."""

from enum import StrEnum


class Reason(StrEnum):
    """The named reasons; journals and reports show the value."""

    NOT_A_FILE = "not_a_file"
    TOO_LARGE = "too_large"
    NOT_JPEG = "not_jpeg"
    NOT_RAW = "not_raw"
    TRUNCATED = "truncated"
    DAMAGED = "damaged"
    UNSUPPORTED = "unsupported"
    TRAILING_DATA = "trailing_data"
    EXIF_DAMAGED = "exif_damaged"
    EXIF_MISSING = "exif_missing"
    WRONG_SIZE = "wrong_size"
    WRONG_EXPOSURE = "wrong_exposure"
    WRONG_ISO = "wrong_iso"
    WRONG_F_NUMBER = "wrong_f_number"
    WRONG_DATE = "wrong_date"
    WRONG_CAMERA = "wrong_camera"
    BLACK = "black"
    TOO_DARK = "too_dark"
    REPEATED = "repeated"
    OUT_OF_ORDER = "out_of_order"
    TOO_SLOW = "too_slow"
    TOO_MUCH_MEMORY = "too_much_memory"
    DECODER_DIED = "decoder_died"


class FrameProblemError(Exception):
    """A problem found in the bytes of a file, before anyone knows the file's name."""

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason = reason
        self.message = message
