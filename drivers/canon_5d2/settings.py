"""The fixed settings of a bracket on an EOS camera: as codes, checked against the camera's own lists, read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from drivers.camera import CameraSettings, SettingReadback
from drivers.canon_5d2.codes import AE_MANUAL, DRIVE_SINGLE, FOCUS_MANUAL, WB_COLOR_TEMPERATURE, CanonProp
from drivers.canon_5d2.operations import (
    JPEG_LARGE_FINE,
    RAW_FULL,
    ImageFile,
    decode_image_format,
    encode_image_format,
    encode_number,
)
from drivers.canon_5d2.remote import CanonRemote
from drivers.canon_5d2.values import (
    AE_MODES,
    DESTINATIONS,
    DRIVE_MODES,
    WHITE_BALANCES,
    aperture_code,
    aperture_text,
    image_format_text,
    iso_code,
    iso_text,
)
from drivers.errors import OperationRefusedError, ProtocolViolationError, SettingRefusedError

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


def _number_words(words: Callable[[int], str]) -> Callable[[bytes], str]:
    return lambda raw: words(int.from_bytes(raw, "little")) if raw else "nothing told"


def _table_words(table: Mapping[int, str]) -> Callable[[bytes], str]:
    return _number_words(lambda code: table.get(code, f"code {code:#x}"))


def _format_words(raw: bytes) -> str:
    try:
        return image_format_text(decode_image_format(raw))
    except ProtocolViolationError:
        return f"bytes {raw[:40].hex()}"


iso_words = _number_words(iso_text)
aperture_words = _number_words(aperture_text)
ae_mode_words = _table_words(AE_MODES)


def fixed_settings(
    settings: CameraSettings,
    remote: CanonRemote,
    *,
    sizes_px: Mapping[int, tuple[int, int]],
    destination: int,
) -> tuple[CanonSetting, ...]:
    """Return what a bracket keeps fixed, in the order to make it.

    Raises `SettingRefusedError`: the camera's tables have no such ISO, aperture or picture size.
    """
    iso, aperture = iso_code(settings.iso), aperture_code(settings.f_number)
    if iso is None:
        raise refused("ISO", settings.iso, "not among the camera's ISO speeds")
    if aperture is None:
        raise refused("aperture", f"f/{settings.f_number:g}", "not among the camera's apertures")
    kelvin = encode_number(settings.color_temperature_k)
    image_format = encode_image_format(_image_format(settings, remote, sizes_px))
    return (
        CanonSetting("drive mode", CanonProp.DRIVE_MODE, encode_number(DRIVE_SINGLE), _table_words(DRIVE_MODES)),
        CanonSetting("image format", CanonProp.IMAGE_FORMAT, image_format, _format_words),
        CanonSetting(
            "white balance", CanonProp.WHITE_BALANCE, encode_number(WB_COLOR_TEMPERATURE), _table_words(WHITE_BALANCES)
        ),
        CanonSetting("colour temperature", CanonProp.COLOR_TEMPERATURE, kelvin, _number_words(lambda k: f"{k} K")),
        CanonSetting("ISO", CanonProp.ISO_SPEED, encode_number(iso), iso_words),
        CanonSetting("aperture", CanonProp.APERTURE, encode_number(aperture), aperture_words),
        CanonSetting(
            "destination", CanonProp.CAPTURE_DESTINATION, encode_number(destination), _table_words(DESTINATIONS)
        ),
    )


def _image_format(
    settings: CameraSettings, remote: CanonRemote, sizes_px: Mapping[int, tuple[int, int]]
) -> tuple[ImageFile, ...]:
    """Return the files a shot is to make, in the order in which the camera itself lists them."""
    asked = (settings.width_px, settings.height_px)
    size = next((code for code, size_px in sizes_px.items() if size_px == asked), None)
    if size is None:
        offered = ", ".join(f"{w}x{h}" for w, h in sizes_px.values())
        raise refused("picture size", f"{asked[0]}x{asked[1]}", offered)
    jpeg = ImageFile(JPEG_LARGE_FINE.file_type, size, JPEG_LARGE_FINE.compression)
    wanted = (RAW_FULL, jpeg) if settings.keep_raw else (jpeg,)
    listed = remote.lists.get(CanonProp.IMAGE_FORMAT)
    formats = listed.formats if listed is not None else ()
    return next((f for f in formats if sorted(f) == sorted(wanted)), wanted)


def refused(name: str, asked: object, got: object, **details: Any) -> SettingRefusedError:
    """Return the error for a setting that the camera does not take."""
    return SettingRefusedError(
        f"{name} cannot be set: asked {asked}, got {got}",
        where=WHERE,
        likely="the camera or its lens has no such value, or a control on the camera excludes it",
        advice="correct the rig file, or check the controls on the camera",
        setting=name,
        asked=str(asked),
        got=str(got),
        **details,
    )


def make(remote: CanonRemote, setting: CanonSetting) -> SettingReadback:
    """Make one setting and return what the camera reports; `SettingRefusedError` where it is something else."""
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
    if listed is None or not listed.numbers or int.from_bytes(setting.raw, "little") in listed.numbers:
        return
    offered = ", ".join(setting.describe(encode_number(n)) for n in listed.numbers)
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
    if mode is not None and mode != AE_MANUAL:
        problems.append(f"the mode dial stands at {AE_MODES.get(mode, hex(mode))}: turn it to M")
    focus = remote.number(CanonProp.FOCUS_MODE)
    if focus is not None and focus != FOCUS_MANUAL:
        problems.append("the lens is on AF: switch it to MF and focus by hand")
    return tuple(problems)


def require_controls(remote: CanonRemote) -> None:
    """Raise `SettingRefusedError` naming every control that stands wrong."""
    problems = control_problems(remote)
    if problems:
        raise SettingRefusedError(
            "; ".join(problems),
            where=WHERE,
            likely="a control on the camera itself",
            advice="; ".join(problems),
            problems=list(problems),
        )
