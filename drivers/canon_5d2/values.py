"""Canon's setting codes as quantities and back: shutter, aperture, ISO, image format, battery, clock, release result.

Source: code tables of `drivers.canon_5d2.codes`. Codes of shutter and aperture step by 1/8 EV.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from datetime import UTC, datetime

from drivers.canon_5d2.codes import (
    APERTURE_CODES,
    IMAGE_COMPRESSION_FINE,
    IMAGE_COMPRESSION_NORMAL,
    IMAGE_SIZE_LARGE,
    IMAGE_SIZE_MEDIUM,
    IMAGE_SIZE_SMALL,
    IMAGE_TYPE_JPEG,
    IMAGE_TYPE_RAW,
    ISO_CODES,
    SHUTTER_CODES,
    SHUTTER_CODES_HALF,
)
from drivers.canon_5d2.operations import ImageFile

SHUTTER_S: Mapping[int, float] = {**SHUTTER_CODES_HALF, **SHUTTER_CODES}
"""Shutter code -> nominal seconds, third and half stops."""

AE_MODES = {0: "P", 1: "Tv", 2: "Av", 3: "M", 4: "B", 5: "A-DEP", 7: "C1", 9: "green", 0x10: "C2", 0x11: "C3"}
DRIVE_MODES = {0: "single", 1: "continuous", 4: "fast", 5: "slow", 0x10: "self-timer 10 s", 0x11: "self-timer 2 s"}
WHITE_BALANCES = {0: "auto", 1: "daylight", 2: "cloudy", 3: "tungsten", 4: "fluorescent", 5: "flash", 6: "manual",
                  8: "shade", 9: "colour temperature", 0x0A: "PC-1", 0x0B: "PC-2", 0x0C: "PC-3"}  # fmt: skip
DESTINATIONS = {2: "card", 4: "computer", 6: "card and computer"}
BATTERY_FRAC = {0: 0.05, 1: 0.5, 2: 1.0, 4: 0.75, 5: 0.25}
"""D111 -> charge; the camera tells quarters only, and "low" for 0 (libgphoto2)."""

RELEASE_OK = 0
RELEASE_RESULTS = {1: "no focus", 3: "the mirror is up", 7: "the card is full", 8: "the card is write-protected"}
RELEASE_CARD_RESULTS = frozenset({7, 8})
_RELEASE_ERROR_MASK, _RELEASE_ERROR = 0x7000, 0x2000


def shutter_codes_known(codes: Iterable[int]) -> tuple[int, ...]:
    """Return those of ``codes`` that stand for an exposure time (bulb and unknown ones left out), longest first."""
    return tuple(sorted(code for code in set(codes) if code in SHUTTER_S))


def nearest_shutter_code(shutter_s: float, codes: Collection[int]) -> int:
    """Return the code whose nominal time is nearest to ``shutter_s`` (> 0 s) on the scale of stops.

    Raises `ValueError`: ``shutter_s`` is no positive time, or no code is known.
    """
    known = shutter_codes_known(codes)
    if not known or not (shutter_s > 0 and math.isfinite(shutter_s)):
        raise ValueError(f"no shutter code for {shutter_s!r} s among {len(known)} known ones")
    return min(known, key=lambda code: abs(math.log2(SHUTTER_S[code] / shutter_s)))


def aperture_code(f_number: float) -> int | None:
    """Return the code of an f-number, or None where the camera's tables have none."""
    return next((code for code, n in APERTURE_CODES.items() if math.isclose(n, f_number, rel_tol=1e-3)), None)


def iso_code(iso: int) -> int | None:
    """Return the code of an ISO speed, or None where the camera's tables have none."""
    return next((code for code, n in ISO_CODES.items() if n == iso), None)


def aperture_text(code: int) -> str:
    """Return an aperture code in words: ``f/16``."""
    return f"f/{APERTURE_CODES[code]:g}" if code in APERTURE_CODES else f"code {code:#x}"


def iso_text(code: int) -> str:
    """Return an ISO code in words: ``200``."""
    return str(ISO_CODES[code]) if code in ISO_CODES else "auto" if code == 0 else f"code {code:#x}"


def image_format_text(files: Iterable[ImageFile]) -> str:
    """Return an image format in words: ``JPEG L fine + RAW L``."""
    kinds = {IMAGE_TYPE_JPEG: "JPEG", IMAGE_TYPE_RAW: "RAW"}
    sizes = {IMAGE_SIZE_LARGE: "L", IMAGE_SIZE_MEDIUM: "M", IMAGE_SIZE_SMALL: "S"}
    qualities = {IMAGE_COMPRESSION_NORMAL: " normal", IMAGE_COMPRESSION_FINE: " fine"}
    return " + ".join(
        f"{kinds.get(f.file_type, f'type {f.file_type}')} {sizes.get(f.size, f'size {f.size}')}"
        f"{qualities.get(f.compression, '')}"
        for f in sorted(files)
    )


def camera_time_utc(seconds: int, now_utc: datetime) -> datetime:
    """Return the camera's clock (D113) as UTC; ``now_utc`` is the computer's.

    The number counts seconds since 1970. The camera knows no time zone, and no source says whether it counts UTC or
    the local time on its display; the reading that is nearer to the computer's clock is taken.
    """
    as_utc = datetime.fromtimestamp(seconds, UTC)
    as_local = as_utc.replace(tzinfo=None).astimezone(UTC)
    return min(as_utc, as_local, key=lambda reading: abs(reading - now_utc))


def release_problem(result: int) -> str | None:
    """Return what the first parameter of a RemoteRelease answer complains of, or None where it does not."""
    if result == RELEASE_OK:
        return None
    if result in RELEASE_RESULTS:
        return RELEASE_RESULTS[result]
    if result & _RELEASE_ERROR_MASK == _RELEASE_ERROR:
        return f"release error {result:#x}"
    return None
