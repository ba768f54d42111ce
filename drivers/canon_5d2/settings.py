"""The fixed settings of a bracket on an EOS camera: as codes, checked against the camera's own lists, read back."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from drivers.camera import CameraSettings, SettingReadback
from drivers.canon_5d2 import codes as canon_codes
from drivers.canon_5d2 import operations
from drivers.canon_5d2.codes import APERTURE_CODES, DESTINATION_PC, ISO_CODES, WB_COLOR_TEMPERATURE, CanonProp
from drivers.canon_5d2.remote import CanonRemote
from drivers.errors import OperationRefusedError, ProtocolViolationError, SettingRefusedError

SHUTTER_S: Mapping[int, float] = {**canon_codes.SHUTTER_CODES_HALF, **canon_codes.SHUTTER_CODES}
"""Shutter code -> nominal seconds, third and half stops."""

AE_MODES = {0: "P", 1: "Tv", 2: "Av", 3: "M", 4: "B", 5: "A-DEP", 7: "C1", 9: "green", 0x10: "C2", 0x11: "C3"}
DRIVE_MODES = {0: "single", 1: "continuous", 4: "fast", 5: "slow", 0x10: "self-timer 10 s", 0x11: "self-timer 2 s"}
WHITE_BALANCES = canon_codes.code_words("white_balance")
DESTINATIONS = {1: "card", 2: "card", 4: "computer", 5: "card and computer", 6: "card and computer"}
BATTERY_FRAC = {0: 0.05, 1: 0.5, 2: 1.0, 4: 0.75, 5: 0.25}
"""D111 -> charge; the camera reports quarters only, and "low" for 0 (libgphoto2)."""

# As libgphoto2 numbers the results; 0 is good
RELEASE_RESULTS = {1: "no focus", 3: "the mirror is up", 7: "the card is full", 8: "the card is write-protected"}
RELEASE_CARD_RESULTS = frozenset({7, 8})
_RELEASE_ERROR_MASK, _RELEASE_ERROR = 0x7000, 0x2000


def shutter_codes_known(codes: Iterable[int]) -> tuple[int, ...]:
    """Return those of ``codes`` that stand for an exposure time (bulb and unknown ones left out), longest first."""
    return tuple(sorted(code for code in set(codes) if code in SHUTTER_S))


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


def image_format_text(files: Iterable[operations.ImageFile]) -> str:
    """Return an image format in words: ``JPEG L fine + RAW L``."""
    kinds = {canon_codes.IMAGE_TYPE_JPEG: "JPEG", canon_codes.IMAGE_TYPE_RAW: "RAW"}
    sizes = {canon_codes.IMAGE_SIZE_LARGE: "L", canon_codes.IMAGE_SIZE_MEDIUM: "M", canon_codes.IMAGE_SIZE_SMALL: "S"}
    qualities = {canon_codes.IMAGE_COMPRESSION_NORMAL: " normal", canon_codes.IMAGE_COMPRESSION_FINE: " fine"}
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
    if result & _RELEASE_ERROR_MASK == _RELEASE_ERROR:
        return f"release error {result:#x}"
    return RELEASE_RESULTS.get(result)


WHERE = "EOS 5D Mark II"


@dataclass(frozen=True)
class CanonSetting:
    """One setting: its name, property, value on the wire, and how to put a value into words."""

    name: str
    prop: int
    raw: bytes
    describe: Callable[[bytes], str]

    @property
    def text(self) -> str:
        """The value in words."""
        return self.describe(self.raw)


def number_words(words: Callable[[int], str]) -> Callable[[bytes], str]:
    """Return a describer of raw values that are numbers."""
    return lambda raw: words(int.from_bytes(raw, "little")) if raw else "nothing reported"


def _table_words(table: Mapping[int, str]) -> Callable[[bytes], str]:
    return number_words(lambda code: table.get(code, f"code {code:#x}"))


def _format_words(raw: bytes) -> str:
    try:
        return image_format_text(operations.decode_image_format(raw))
    except ProtocolViolationError:
        return f"bytes {raw[:40].hex()}"


ae_mode_words = _table_words(AE_MODES)
shutter_words = _table_words({code: f"{seconds:g} s" for code, seconds in SHUTTER_S.items()})


def fixed_settings(
    settings: CameraSettings, remote: CanonRemote, *, sizes_px: Mapping[int, tuple[int, int]], to_card: bool
) -> tuple[CanonSetting, ...]:
    """Return what a bracket keeps fixed, in the order to make it.

    Raises `SettingRefusedError`: the camera's tables have no such ISO, aperture or picture size.
    """
    iso, aperture = iso_code(settings.iso), aperture_code(settings.f_number)
    if iso is None:
        raise refused("ISO", settings.iso, "not among the camera's ISO speeds")
    if aperture is None:
        raise refused("aperture", f"f/{settings.f_number:g}", "not among the camera's apertures")
    kelvin = operations.encode_number(settings.color_temperature_k)
    # The files a shot is to make, in the order in which the camera itself lists them
    asked = (settings.width_px, settings.height_px)
    size = next((code for code, size_px in sizes_px.items() if size_px == asked), None)
    if size is None:
        raise refused("picture size", f"{asked[0]}x{asked[1]}", ", ".join(f"{w}x{h}" for w, h in sizes_px.values()))
    jpeg = operations.ImageFile(operations.JPEG_LARGE_FINE.file_type, size, operations.JPEG_LARGE_FINE.compression)
    wanted = (operations.RAW_FULL, jpeg) if settings.keep_raw else (jpeg,)
    listed = remote.lists.get(CanonProp.IMAGE_FORMAT)
    formats = listed.formats if listed is not None else ()
    image_format = operations.encode_image_format(next((f for f in formats if sorted(f) == sorted(wanted)), wanted))
    white_balance, destination = operations.encode_number(WB_COLOR_TEMPERATURE), _destination(remote, to_card=to_card)
    kelvin_words, single = number_words(lambda k: f"{k} K"), operations.encode_number(canon_codes.DRIVE_SINGLE)
    return (
        CanonSetting("drive mode", CanonProp.DRIVE_MODE, single, _table_words(DRIVE_MODES)),
        CanonSetting("image format", CanonProp.IMAGE_FORMAT, image_format, _format_words),
        CanonSetting("white balance", CanonProp.WHITE_BALANCE, white_balance, _table_words(WHITE_BALANCES)),
        CanonSetting("colour temperature", CanonProp.COLOR_TEMPERATURE, kelvin, kelvin_words),
        CanonSetting("ISO", CanonProp.ISO_SPEED, operations.encode_number(iso), number_words(iso_text)),
        CanonSetting("aperture", CanonProp.APERTURE, operations.encode_number(aperture), number_words(aperture_text)),
        CanonSetting("destination", CanonProp.CAPTURE_DESTINATION, destination, _table_words(DESTINATIONS)),
    )


def _destination(remote: CanonRemote, *, to_card: bool) -> bytes:
    """Return where pictures go: the computer, or the first value listed that is not (also) the computer's."""
    if not to_card:
        return operations.encode_number(DESTINATION_PC)
    listed = remote.lists.get(CanonProp.CAPTURE_DESTINATION)
    codes = (*(listed.numbers if listed else ()), remote.number(CanonProp.CAPTURE_DESTINATION) or DESTINATION_PC)
    code = next((c for c in codes if not c & DESTINATION_PC), None)
    if code is None:
        raise refused("destination", "card", "only: computer (is there a card in the camera?)")
    return operations.encode_number(code)


def refused(name: str, asked: object, got: object, **details: Any) -> SettingRefusedError:
    """Return the error for a setting that the camera does not take."""
    text = f"{name} cannot be set: asked {asked}, got {got}"
    likely = "the camera or its lens has no such value, or a control on the camera excludes it"
    advice = "correct the rig file, or check the controls on the camera"
    return SettingRefusedError(
        text, where=WHERE, likely=likely, advice=advice, setting=name, asked=str(asked), got=str(got), **details
    )


def make(remote: CanonRemote, setting: CanonSetting) -> SettingReadback:
    """Make one setting and return what the camera reports; `SettingRefusedError` where it is something else.

    A value that the camera does not list is never written: an image format that a 5D Mark II did not list has locked
    it for good (Magic Lantern's a1ex, reproduced; ERR70).
    """
    if remote.values.get(setting.prop) != setting.raw:
        _require_listed(remote, setting)
    try:
        got = remote.ensure(setting.prop, setting.raw)
    except OperationRefusedError as error:
        raise refused(setting.name, setting.text, f"response {error.response_code:#06x}") from error
    if got != setting.raw:
        raise refused(setting.name, setting.text, setting.describe(got), raw=got[:64].hex())
    return SettingReadback(setting.name, setting.text, setting.describe(got), got.hex())


def _require_listed(remote: CanonRemote, setting: CanonSetting) -> None:
    listed = remote.lists.get(setting.prop)
    values = [operations.encode_number(n) for n in listed.numbers] if listed else []
    values += [operations.encode_image_format(f) for f in listed.formats] if listed else []
    if setting.raw not in values:
        offered = ", ".join(setting.describe(v) for v in values) or "no values at all just now"
        raise refused(setting.name, setting.text, f"only: {offered}")


def require_kept(remote: CanonRemote, setting: CanonSetting) -> None:
    """Check that nobody has changed a setting since; `SettingRefusedError` where somebody has."""
    got = remote.values.get(setting.prop, b"")
    if got == setting.raw:
        return
    error = refused(setting.name, setting.text, setting.describe(got))
    error.likely = "somebody turned a dial, or the camera was switched off and on"
    error.advice = "leave the camera alone and take the bracket again"
    raise error


def control_problems(remote: CanonRemote) -> tuple[str, ...]:
    """Return what stands wrong on the camera's own controls, which no computer can turn."""
    problems = []
    mode = remote.number(CanonProp.AUTO_EXPOSURE_MODE)
    if mode is not None and mode != canon_codes.AE_MANUAL:
        problems.append(f"the mode dial stands at {AE_MODES.get(mode, hex(mode))}: turn it to M")
    focus = remote.number(CanonProp.FOCUS_MODE)
    if focus is not None and focus != canon_codes.FOCUS_MANUAL:
        problems.append("the lens is on AF: switch it to MF and focus by hand")
    return tuple(problems)


def require_controls(remote: CanonRemote) -> None:
    """Raise `SettingRefusedError` naming every control that stands wrong."""
    problems = control_problems(remote)
    if problems:
        text, likely = "; ".join(problems), "a control on the camera itself"
        raise SettingRefusedError(text, where=WHERE, likely=likely, advice=text, problems=list(problems))
