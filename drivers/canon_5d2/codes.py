"""Code tables of Canon's PTP extension as spoken by the EOS 5D Mark II (devices.md section 3)."""

import tomllib
from enum import IntEnum
from importlib.resources import files

# As lsusb lists a 5D Mark II (libgphoto2 camlibs/ptp2).
USB_ID = (0x04A9, 0x3199)
VENDOR_EXTENSION_IDS = (0x00000006, 0x0000000B)
"""EOS bodies name Microsoft's extension (raw replies of a 60D; reports of 5D Mark II, 550D, 1000D), older Canons their
own, which libgphoto2 shows for both. Either way the operations at 911xh mark an EOS."""


class CanonOperation(IntEnum):
    """Vendor operations."""

    GET_STORAGE_IDS = 0x9101
    GET_STORAGE_INFO = 0x9102
    GET_OBJECT_INFO = 0x9103
    GET_OBJECT = 0x9104
    DELETE_OBJECT = 0x9105
    GET_PARTIAL_OBJECT = 0x9107
    GET_DEVICE_INFO_EX = 0x9108
    GET_OBJECT_INFO_EX = 0x9109
    REMOTE_RELEASE = 0x910F
    SET_DEVICE_PROP_VALUE_EX = 0x9110
    GET_REMOTE_MODE = 0x9113
    SET_REMOTE_MODE = 0x9114
    SET_EVENT_MODE = 0x9115
    GET_EVENT = 0x9116
    TRANSFER_COMPLETE = 0x9117
    CANCEL_TRANSFER = 0x9118
    PC_HDD_CAPACITY = 0x911A
    SET_UI_LOCK = 0x911B
    RESET_UI_LOCK = 0x911C
    KEEP_DEVICE_ON = 0x911D
    BULB_START = 0x9125
    BULB_END = 0x9126
    REQUEST_DEVICE_PROP_VALUE = 0x9127
    REMOTE_RELEASE_ON = 0x9128
    REMOTE_RELEASE_OFF = 0x9129
    DO_AF = 0x9154
    AF_CANCEL = 0x9160


class CanonProp(IntEnum):
    """EOS properties that we use, seen only through GetEvent."""

    APERTURE = 0xD101
    SHUTTER_SPEED = 0xD102
    ISO_SPEED = 0xD103
    AUTO_EXPOSURE_MODE = 0xD105
    DRIVE_MODE = 0xD106
    FOCUS_MODE = 0xD108
    WHITE_BALANCE = 0xD109
    COLOR_TEMPERATURE = 0xD10A
    WB_SHIFT_AB = 0xD10B
    WB_SHIFT_GM = 0xD10C
    WB_BRACKET_AB = 0xD10D
    WB_BRACKET_GM = 0xD10E
    COLOR_SPACE = 0xD10F
    PICTURE_STYLE = 0xD110
    BATTERY_POWER = 0xD111
    CAMERA_TIME = 0xD113
    AUTO_POWER_OFF = 0xD114
    OWNER = 0xD115
    AVAILABLE_SHOTS = 0xD11B
    CAPTURE_DESTINATION = 0xD11C
    IMAGE_FORMAT = 0xD120
    MIRROR_UP_SETTING = 0xD13A
    HIGHLIGHT_TONE_PRIORITY = 0xD13B
    CUSTOM_FUNCTIONS = 0xD1A0
    SERIAL_NUMBER = 0xD1AF
    MIRROR_LOCKUP_STATE = 0xD1BF
    LIGHTING_OPTIMISER = 0xD1C1
    ARTIST = 0xD1D0
    COPYRIGHT = 0xD1D1
    FOCUS_INFO_EX = 0xD1D3
    EXPOSURE_BRACKETING = 0xD1D9


class CanonEvent(IntEnum):
    """Records of the GetEvent stream that we use."""

    REQUEST_GET_EVENT = 0xC101
    OBJECT_ADDED_EX = 0xC181
    OBJECT_REMOVED = 0xC182
    STORAGE_STATUS_CHANGED = 0xC184
    STORAGE_INFO_CHANGED = 0xC185
    REQUEST_OBJECT_TRANSFER = 0xC186
    OBJECT_INFO_CHANGED_EX = 0xC187
    PROP_VALUE_CHANGED = 0xC189
    AVAIL_LIST_CHANGED = 0xC18A
    CAMERA_STATUS_CHANGED = 0xC18B
    WILL_SOON_SHUTDOWN = 0xC18D
    REQUEST_OBJECT_TRANSFER_DT = 0xC190
    BULB_EXPOSURE_TIME = 0xC194
    CTG_INFO_CHECK_COMPLETE = 0xC1A4


class CanonResponse(IntEnum):
    """Vendor response codes that we use."""

    UNKNOWN_COMMAND = 0xA001
    OPERATION_REFUSED = 0xA005
    LOW_BATTERY = 0xA101


# Values of the EOS properties (libgphoto2 camlibs/ptp2).
AE_MANUAL = 3
AE_BULB = 4  # libgphoto2: on the 5D Mark II's dial
DRIVE_SINGLE = 0  # libgphoto2: one frame a release
FOCUS_MANUAL = 3  # libgphoto2: the lens's switch on MF
WB_COLOR_TEMPERATURE = 9  # libgphoto2: the temperature is a property of its own
DESTINATION_PC = 4
"""A bit of D11C: set where pictures go to the computer. What stands for a card differs: 1 on bodies with CompactFlash,
2 on those with SD (lists of a 5D Mark III and a 60D)."""
LIST_FORM = 3  # the list of allowed values, as in the recordings

_tables = tomllib.loads((files(__package__) / "codes.toml").read_text("utf-8"))


def _table(name: str) -> dict[int, float]:
    """Return a table of ``codes.toml`` by code; "1/60" is a sixtieth."""
    return {int(code, 16): 1 / int(v[2:]) if isinstance(v, str) else v for code, v in _tables[name].items()}


def code_words(name: str) -> dict[int, str]:
    """Return a table of ``codes.toml`` that says in words what a property's codes mean."""
    return {int(code, 16): str(words) for code, words in _tables[name].items()}


SHUTTER_CODES = _table("shutter_thirds")  # shutter code -> nominal seconds, third-stop list; code = 38h + 8 log2(1/t)
SHUTTER_CODES_HALF = _table("shutter_halves")
ISO_CODES = {code: int(iso) for code, iso in _table("iso").items()}
APERTURE_CODES = _table("aperture")

# Codes of an image-format entry (libgphoto2 camlibs/ptp2).
IMAGE_TYPE_JPEG = 1
IMAGE_TYPE_RAW = 6  # CR2
IMAGE_SIZE_LARGE, IMAGE_SIZE_MEDIUM, IMAGE_SIZE_SMALL = 0, 1, 2
IMAGE_COMPRESSION_NORMAL, IMAGE_COMPRESSION_FINE, IMAGE_COMPRESSION_RAW = 2, 3, 4
IMAGE_SIZES_PX = {IMAGE_SIZE_LARGE: (5616, 3744), IMAGE_SIZE_MEDIUM: (4080, 2720), IMAGE_SIZE_SMALL: (2784, 1856)}
