"""What a checked frame is known by, and what a frame is expected to be."""

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated

from pydantic import Field, NaiveDatetime

from station.session.session import Fraction, FrameStatistics, Model, PositiveSeconds, SafeText, Sha256

Pixels = Annotated[int, Field(gt=0, le=65_535)]


class ExifRecord(Model):
    """What the camera wrote about the frame, as the worker process read it; None or "" where it wrote nothing.

    ``taken_local`` is the camera's own clock, without zone; ``offset_min`` its zone, minutes east of UTC, where given.
    ``white_balance`` is 0 for automatic and 1 for manual.
    """

    exposure_s: PositiveSeconds | None = None
    f_number: Annotated[float, Field(gt=0, lt=1e10)] | None = None
    iso: Annotated[int, Field(gt=0, lt=2**32)] | None = None
    taken_local: Annotated[NaiveDatetime, Field(ge=datetime(1970, 1, 1), lt=datetime(2101, 1, 1))] | None = None  # noqa: DTZ001
    offset_min: Annotated[int, Field(ge=-840, le=840)] | None = None
    make: SafeText = ""
    model: SafeText = ""
    serial: SafeText = ""
    white_balance: Annotated[int, Field(ge=0, lt=2**32)] | None = None
    orientation: Annotated[int, Field(ge=0, lt=2**32)] | None = None
    width_px: Annotated[int, Field(ge=0, lt=2**32)] | None = None
    height_px: Annotated[int, Field(ge=0, lt=2**32)] | None = None


class FrameFacts(Model):
    """What the worker process found in one file.

    The worker handles strangers' bytes, so nothing it says is trusted beyond this model: the digest that the
    session keeps is computed by the station itself.
    """

    name: SafeText
    """The file's own name, for messages; never a path."""
    size_bytes: Annotated[int, Field(gt=0, le=1_000_000_000)]
    sha256: Sha256
    width_px: Pixels | None = None
    height_px: Pixels | None = None
    exif: ExifRecord = ExifRecord()
    exif_problem: SafeText = ""
    """Why there is no EXIF: none in the file, or damaged."""
    mean_frac: Fraction = 0.0
    clipped_frac: Fraction = 0.0
    dark_frac: Fraction = 0.0
    clipped_rgb_frac: tuple[Fraction, Fraction, Fraction] = (0.0, 0.0, 0.0)
    exact: bool = False
    """Whether the measures count every pixel; otherwise each is a mean over a block of up to 8x8."""
    picture_sha256: Sha256 | None = None
    """Digest of the small picture; None where it is nearly all black or clipped, as others may be too."""
    patches: tuple[Fraction, ...] = ()
    """Linear brightness (by the sRGB curve) of 8 rows of 16 parts of the picture; 0 outside a fisheye's circle."""
    noise: tuple[Fraction, ...] = ()
    """Relative, of a single pixel in each of these parts, where every pixel was looked at; 0: not known."""
    notes: tuple[SafeText, ...] = ()

    @property
    def statistics(self) -> FrameStatistics:
        """The brightness, as the manifest keeps it."""
        return FrameStatistics(mean_frac=self.mean_frac, clipped_frac=self.clipped_frac, dark_frac=self.dark_frac)


@dataclass(frozen=True)
class ExpectedFrame:
    """What was asked of the camera; None means "not checked".

    ``exposure_s`` is the nominal time read back from the camera. The moment of release lies between
    ``taken_after_utc`` and ``taken_before_utc`` by our clock; ``clock_offset_s`` is the camera's clock minus
    ours (None: unknown, the date is not checked). ``require_exif`` refuses a frame whose EXIF is missing or
    damaged. ``light_expected`` refuses a wholly black frame at stops where even a dim room shows something.
    """

    exposure_s: float | None = None
    iso: int | None = None
    f_number: float | None = None
    width_px: int | None = None
    height_px: int | None = None
    taken_after_utc: datetime | None = None
    taken_before_utc: datetime | None = None
    clock_offset_s: float | None = None
    require_exif: bool = True
    light_expected: bool = True
    image_circle: tuple[float, float, float] | None = None
    """Of a fisheye: centre column, centre row, radius as fractions of width, height and width; only inside it is
    brightness measured."""
