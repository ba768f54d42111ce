"""What an EOS is set to beside the rig's settings, and what that does to a bracket: set, recorded, or refused.

The ids of the custom functions are those of a 60D (its menus II-1 to 3 and III-5, in the same order) and a 1000D; a 5D
Mark II's have not been recorded. They are never written: no camera lists values for them.
"""

from collections.abc import Iterator, Mapping

from drivers.camera import NOT_REPORTED, BodySetting, Verdict
from drivers.canon_5d2.codes import CanonProp, code_words
from drivers.canon_5d2.operations import encode_number
from drivers.canon_5d2.remote import CanonRemote
from drivers.canon_5d2.settings import CanonSetting, make, number_words

PICTURE_STYLES = code_words("picture_style")
UNUSABLE_STYLES = {0x86: "it takes the colour out", 0x87: "it changes the curve from frame to frame"}
COLOUR_SPACES = {1: "sRGB", 2: "Adobe RGB"}
SRGB = 1  # the camera's number, as in the table above
LONG_EXPOSURE_NR, HIGH_ISO_NR, TONE_PRIORITY, OPTIMISER, MIRROR_LOCKUP = 0x201, 0x202, 0x203, 0x204, 0x60F
"""Ids of custom functions."""
NR_WORDS = {0: "off", 1: "auto", 2: "on"}
HIGH_ISO_WORDS = {0: "standard", 1: "low", 2: "strong", 3: "off"}
OPTIMISER_OFF, OPTIMISER_WHEN_MANUAL = 3, 0x10000
"""D1C1: the low byte 3 is "off"; without the bit it is off in mode M anyway (libgphoto2)."""


def read_body(remote: CanonRemote) -> tuple[BodySetting, ...]:
    """Set what may be set, and return all settings of the body that a bracket depends on.

    Raises `SettingRefusedError`: the camera lists a value, and does not take it.
    """
    seconds = remote.number(CanonProp.AUTO_POWER_OFF)
    got = NOT_REPORTED if seconds is None else "never" if seconds == 0 else f"after {seconds} s"
    power = BodySetting("auto power off", got, "" if seconds is None else str(seconds), Verdict.RECORDED)
    return (*_set(remote), _style(remote), *_tones(remote), *_noise(remote.functions), power)


def _set(remote: CanonRemote) -> Iterator[BodySetting]:
    """Make settings that have one right value, where the camera lists it: a JPEG is taken for sRGB, and a frame for the
    one that was asked for."""
    words = number_words(lambda n: COLOUR_SPACES.get(n, f"code {n:#x}"))
    yield _made(remote, CanonSetting("colour space", CanonProp.COLOR_SPACE, encode_number(SRGB), words))
    shift = number_words(lambda n: "none" if n == 0 else f"{(n + 0x80000000) % 0x100000000 - 0x80000000:+d}")
    for name, prop in (
        ("white-balance shift amber-blue", CanonProp.WB_SHIFT_AB),
        ("white-balance shift green-magenta", CanonProp.WB_SHIFT_GM),
        ("white-balance bracketing amber-blue", CanonProp.WB_BRACKET_AB),
        ("white-balance bracketing green-magenta", CanonProp.WB_BRACKET_GM),
        ("exposure bracketing", CanonProp.EXPOSURE_BRACKETING),
    ):
        yield _made(remote, CanonSetting(name, prop, encode_number(0), shift))


def _made(remote: CanonRemote, setting: CanonSetting) -> BodySetting:
    before, listed = remote.values.get(setting.prop), remote.lists.get(setting.prop)
    if before is None:
        return BodySetting(setting.name, NOT_REPORTED, "", Verdict.RECORDED)
    if before == setting.raw:
        return BodySetting(setting.name, setting.text, before.hex(), Verdict.OK)
    if listed is None or int.from_bytes(setting.raw, "little") not in listed.numbers:
        reason = f"it should be {setting.text}, and the camera does not let a computer change it"
        return BodySetting(setting.name, setting.describe(before), before.hex(), Verdict.REFUSED, reason)
    got = make(remote, setting)
    return BodySetting(setting.name, got.got, got.raw, Verdict.SET, f"was {setting.describe(before)}")


def _style(remote: CanonRemote) -> BodySetting:
    name, code = "picture style", remote.number(CanonProp.PICTURE_STYLE)
    if code is None:
        return BodySetting(name, NOT_REPORTED, "", Verdict.RECORDED)
    got, why = PICTURE_STYLES.get(code, f"code {code:#x}"), UNUSABLE_STYLES.get(code, "")
    return BodySetting(name, got, f"{code:#x}", Verdict.REFUSED if why else Verdict.OK, why)


def _tones(remote: CanonRemote) -> Iterator[BodySetting]:
    functions = remote.functions
    priority = _first(remote.number(CanonProp.HIGHLIGHT_TONE_PRIORITY), functions.get(TONE_PRIORITY))
    yield _on_off("highlight tone priority", priority, "it takes ISO 100 away and bends the response curve")
    yield _optimiser(remote.number(CanonProp.LIGHTING_OPTIMISER), functions.get(OPTIMISER))
    lockup = _first(remote.number(CanonProp.MIRROR_UP_SETTING), functions.get(MIRROR_LOCKUP))
    lockup = lockup or remote.number(CanonProp.MIRROR_LOCKUP_STATE) or lockup
    yield _on_off("mirror lock-up", lockup, "the first press takes no picture")


def _first(*found: int | None) -> int | None:
    return next((n for n in found if n is not None), None)


def _on_off(name: str, value: int | None, why_not: str) -> BodySetting:
    if value is None:
        return BodySetting(name, NOT_REPORTED, "", Verdict.RECORDED)
    return BodySetting(name, *(("on", str(value), Verdict.REFUSED, why_not) if value else ("off", "0", Verdict.OK)))


def _optimiser(mode: int | None, function: int | None) -> BodySetting:
    """The lighting optimiser: a property of later bodies, a custom function of those before."""
    name, why = "lighting optimiser", "it brightens each frame by its own content"
    value = _first(mode, function)
    if value is None:
        return BodySetting(name, NOT_REPORTED, "", Verdict.RECORDED)
    off = value & 0xFF == OPTIMISER_OFF or (mode is not None and not mode & OPTIMISER_WHEN_MANUAL)
    return BodySetting(name, *(("off", hex(value), Verdict.OK) if off else ("on", hex(value), Verdict.REFUSED, why)))


def _noise(functions: Mapping[int, int]) -> Iterator[BodySetting]:
    for name, function, words, why in (
        ("long-exposure noise reduction", LONG_EXPOSURE_NR, NR_WORDS, "exposures from a second take twice as long"),
        ("high-ISO noise reduction", HIGH_ISO_NR, HIGH_ISO_WORDS, ""),
    ):
        value = functions.get(function)
        if value is None:
            yield BodySetting(name, NOT_REPORTED, "", Verdict.RECORDED)
        else:
            got = words.get(value, str(value))
            yield BodySetting(name, got, str(value), Verdict.RECORDED, why if value and why else "")
