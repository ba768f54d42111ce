"""The Theta Z1's properties: how each is written and read back, and the fixed settings of a bracket as a table."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Self

from drivers.camera import BodySetting, CameraSettings, SettingReadback, Verdict
from drivers.camera_link import CameraLink
from drivers.clock import Clock
from drivers.errors import DeviceBusyError, OperationRefusedError, SettingRefusedError
from drivers.ptp.codes import DataType, Prop
from drivers.theta_z1 import codes as ricoh_codes
from drivers.theta_z1.codes import RicohProp

F_NUMBER_560 = 560  # in the enumeration of a camera that counts f-numbers times 100


@dataclass(frozen=True)
class Fraction32:
    """A shutter time as the camera writes it: two u32; 4/1 is four seconds, 1/60 a sixtieth, 0/0 automatic."""

    numerator: int
    denominator: int

    @classmethod
    def from_u64(cls, value: int) -> Self:
        """Split the integer that property D00F carries: LE32 numerator, LE32 denominator on the wire."""
        return cls(value & 0xFFFFFFFF, value >> 32)

    def to_u64(self) -> int:
        """Return the integer that property D00F carries."""
        return self.denominator << 32 | self.numerator

    @property
    def is_time(self) -> bool:
        """Whether it stands for a time (0/0 is automatic)."""
        return self.numerator > 0 and self.denominator > 0

    @property
    def seconds(self) -> float:
        """Nominal exposure time; only where `is_time`."""
        return self.numerator / self.denominator

    def __str__(self) -> str:
        return f"{self.numerator}/{self.denominator}"


def f_number_codes(enumeration: Iterable[int]) -> Mapping[int, str] | None:
    """Return the f-number encoding (code -> text) that an enumeration of property 5007 shows, or None.

    Sources disagree: newer pages of the specification number the apertures 1, 2, 3; working scripts write the PTP
    form, f-number times 100. The camera's own list decides.
    """
    values = set(enumeration)
    if F_NUMBER_560 in values:
        return {v: f"{v / 100:g}" if v else "auto" for v in sorted(values)}
    return ricoh_codes.F_NUMBER_INDEX if values == set(ricoh_codes.F_NUMBER_INDEX) else None


def f_number_code(f_number: float, codes: Mapping[int, str]) -> int | None:
    """Return the code of an f-number in an encoding, or None where it has none."""
    return next((key for key, text in codes.items() if key and math.isclose(float(text), f_number, rel_tol=1e-3)), None)


def error_texts(error_info: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return (problems, warnings) that the bits of ErrorInfo (D006) name; unknown bits are warnings."""
    problems: list[str] = []
    warnings: list[str] = []
    for bit in (1 << n for n in range(32)):
        if error_info & bit:
            text, can_shoot = ricoh_codes.ERROR_INFO_BITS.get(bit, (f"unknown error bit {bit:#010x}", True))
            (warnings if can_shoot else problems).append(text)
    return tuple(problems), tuple(warnings)


PROPERTY_PAUSE_S = 0.1  # between two property writes; what scripts that work with the real camera leave
BUSY_LIMIT_S = 5.0  # chosen
SETTING_ATTEMPTS = 2
"""Settings sometimes do not take (seen by others on the real camera): write, compare, write once more."""
TOP_BOTTOM_DISAPPLY = 4  # Ricoh's USB API

_CODES: Mapping[str, int] = {prop.name: prop for prop in (*Prop, *RicohProp)}
PROPERTY_TYPES = {_CODES[name]: DataType[kind] for kind, names in ricoh_codes.TYPES.items() for name in names}


@dataclass(frozen=True)
class Setting:
    """One fixed setting: its name and value in words, and as the camera's property."""

    name: str
    prop: int
    value: int | str
    text: str
    optional: bool = False
    """Whether a camera whose firmware has no such property may be used, with a warning."""


def _meaning(prop: int, value: int | str) -> float | str:
    """Return what a value means: a shutter time may come back reduced, 10/25 as 2/5."""
    time = Fraction32.from_u64(int(value)) if prop == RicohProp.SHUTTER_SPEED else None
    return time.seconds if time is not None and time.is_time else value


class ThetaProperties:
    """Typed reading and writing of properties over a link."""

    def __init__(self, link: CameraLink, clock: Clock) -> None:
        self._link = link
        self._clock = clock

    def has(self, prop: int) -> bool:
        """Whether the camera's firmware lists the property."""
        return prop in self._link.info.properties

    def read(self, prop: int) -> int | str:
        """Return a property's value; `DeviceBusyError` where the camera sleeps or works."""
        value = self._link.session.get_prop_value(prop, PROPERTY_TYPES[prop])
        assert isinstance(value, int | str)
        return value

    def number(self, prop: int) -> int:
        """Return the value of a numeric property."""
        value = self.read(prop)
        assert isinstance(value, int)
        return value

    def number_or_none(self, prop: int) -> int | None:
        """Return the value of a numeric property, or None where the camera does not say just now."""
        value = self.read_or_none(prop)
        return value if isinstance(value, int) else None

    def read_or_none(self, prop: int) -> int | str | None:
        """Return a property's value, or None where the camera does not say just now."""
        try:
            return self.read(prop) if self.has(prop) else None
        except (DeviceBusyError, OperationRefusedError):
            return None

    def write(self, prop: int, value: int | str, busy_limit_s: float = BUSY_LIMIT_S) -> None:
        """Write a property, waiting while the camera is busy."""
        session = self._link.session
        session.retry_busy(lambda: session.set_prop_value(prop, PROPERTY_TYPES[prop], value), busy_limit_s)

    def write_and_compare(self, name: str, prop: int, value: int | str) -> None:
        """Write a property and read it back; `SettingRefusedError` where it does not take, twice."""
        got: int | str = ""
        for _ in range(SETTING_ATTEMPTS):
            try:
                self.write(prop, value)
            except OperationRefusedError as error:
                raise self._refused(name, prop, value, f"response {error.response_code:#06x}") from error
            got = self._link.session.retry_busy(lambda: self.read(prop), BUSY_LIMIT_S)
            if _meaning(prop, got) == _meaning(prop, value):
                return
            self._clock.sleep(PROPERTY_PAUSE_S)
        raise self._refused(name, prop, value, str(got))

    def require(self, name: str, prop: int, value: int | str) -> None:
        """Check that a property still has the value it was given; `SettingRefusedError` where not."""
        got = self._link.session.retry_busy(lambda: self.read(prop), BUSY_LIMIT_S)
        if got != value:
            error = self._refused(name, prop, value, str(got))
            error.likely = "the camera slept or was switched off and on, or somebody changed it by hand"
            error.advice = "leave the camera alone and take the bracket again"
            raise error

    def _refused(self, name: str, prop: int, asked: int | str, got: str) -> SettingRefusedError:
        text = f"{name} cannot be set: asked {asked}, got {got}"
        likely = "this firmware has no such value, or another setting excludes it"
        advice = "check the value in the rig file and the camera's firmware"
        facts = {"setting": name, "property": f"{prop:04X}", "asked": asked, "got": got}
        return SettingRefusedError(text, where=self._link.name, likely=likely, advice=advice, **facts)

    def apply(self, setting: Setting) -> SettingReadback:
        """Make one fixed setting and return what the camera then has."""
        if setting.optional and not self.has(setting.prop):
            return SettingReadback(setting.name, setting.text, "unknown: this firmware cannot set it", "")
        self.write_and_compare(setting.name, setting.prop, setting.value)
        return SettingReadback(setting.name, setting.text, setting.text, str(setting.value))


def mode_settings() -> tuple[Setting, ...]:
    """Return the settings that make the camera take single manual exposures and stay awake, in the order to make."""
    return (
        Setting("sleep", RicohProp.SLEEP_DELAY, 0, "never"),
        Setting("automatic power off", RicohProp.AUTO_POWER_OFF_DELAY, 0, "never"),
        Setting("capture mode", Prop.STILL_CAPTURE_MODE, ricoh_codes.STILL_CAPTURE_SINGLE, "single"),
        Setting("function", RicohProp.FUNCTION, 0, "normal", optional=True),  # "My setting" would bring its own values
        Setting("self-timer", Prop.CAPTURE_DELAY, 0, "off", optional=True),
        # Any filter would force the exposure program back to automatic.
        Setting("filter", RicohProp.FILTER, 0, "off"),
        Setting("exposure program", Prop.EXPOSURE_PROGRAM_MODE, ricoh_codes.EXPOSURE_PROGRAM_MANUAL, "manual"),
    )


def picture_settings(settings: CameraSettings, f_number: int) -> tuple[Setting, ...]:
    """Return what a bracket keeps fixed; ``f_number`` is in the camera's own encoding.

    Stitching is static: by default the camera stitches each frame anew by its content, so that the frames of a
    bracket would not lie on each other. For the same reason the top/bottom correction is off: it turns each frame by
    what the tilt sensor says at that moment; the tripod's level does not move between frames.

    Raises `SettingRefusedError`: an ISO that the camera does not have (65535 would be automatic).
    """
    if settings.iso not in ricoh_codes.ISO_VALUES:
        text = f"ISO {settings.iso} cannot be set: the camera has {', '.join(map(str, ricoh_codes.ISO_VALUES))}"
        raise SettingRefusedError(text, where="Theta Z1", advice="correct iso in the rig file", asked=settings.iso)
    size = f"{settings.width_px}x{settings.height_px}"
    raw, kelvin, iso = int(settings.keep_raw), settings.color_temperature_k, settings.iso
    return (
        Setting("image size", Prop.IMAGE_SIZE, size, size),
        Setting("image format", RicohProp.IMAGE_FORMAT, raw, "JPEG + DNG" if raw else "JPEG"),
        Setting("stitching", RicohProp.IMAGE_STITCHING, ricoh_codes.STITCHING_STATIC, "static", optional=True),
        Setting("top/bottom correction", RicohProp.TOP_BOTTOM_CORRECTION, TOP_BOTTOM_DISAPPLY, "off", optional=True),
        Setting("white balance", Prop.WHITE_BALANCE, ricoh_codes.WHITE_BALANCE_COLOR_TEMPERATURE, "colour temperature"),
        Setting("colour temperature", RicohProp.COLOR_TEMPERATURE, kelvin, f"{kelvin} K"),
        Setting("f-number", Prop.F_NUMBER, f_number, f"f/{settings.f_number:g}"),
        Setting("ISO", Prop.EXPOSURE_INDEX, iso, str(iso)),
    )


STOPS_SHOOTING = ((2, 30, 1), (3, 0))
"""Firmware that stops taking pictures over USB after 0 to 20 minutes (theta-api-specs issue 34; 2.11.1 does not)."""


def read_body(properties: ThetaProperties, firmware: str) -> tuple[BodySetting, ...]:
    """Return what a bracket depends on and only another firmware can change."""
    version = tuple(int(part) if part.isdigit() else 0 for part in firmware.split("."))
    stops = any(version[: len(bad)] == bad for bad in STOPS_SHOOTING)
    static = properties.has(RicohProp.IMAGE_STITCHING)
    why = "it stops taking pictures within minutes (2.30.1 and 3.0): install 2.11.1 or a later one than 3.0"
    anew = "it stitches each frame separately, so frames do not align: install 2.10.1 or later"
    return tuple(
        BodySetting(name, text, raw, Verdict.OK if fit else Verdict.REFUSED, "" if fit else unfit)
        for name, text, raw, fit, unfit in (
            ("firmware", firmware, firmware, not stops, why),
            ("static stitching", "yes" if static else "no", str(int(static)), static, anew),
        )
    )


def find_f_number(link: CameraLink, f_number: float) -> int:
    """Return an f-number in the encoding that the camera's own list shows; the program must be manual already.

    Raises `SettingRefusedError`: the list is of neither known encoding, or has no such f-number.
    """
    session = link.session
    desc = session.retry_busy(lambda: session.get_prop_desc(Prop.F_NUMBER), BUSY_LIMIT_S)
    listed = [v for v in desc.choices if isinstance(v, int)]
    codes = f_number_codes(listed)
    code = None if codes is None else f_number_code(f_number, codes)
    if code is not None:
        return code
    text = f"f-number cannot be set: asked f/{f_number:g}, the camera lists {listed}"
    likely, advice = "the lens has no such aperture (2.1, 3.5, 5.6)", "correct f_number in the rig file"
    if not codes:
        likely, advice = "a firmware whose f-number encoding is not known", "report the camera's firmware and this list"
    facts = {"setting": "f-number", "asked": f_number, "got": listed}
    raise SettingRefusedError(text, where=link.name, likely=likely, advice=advice, **facts)
