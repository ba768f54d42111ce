"""Code tables of PTP (ISO 15740) and of its USB still-image class; names and numbers, nothing else.

The simulated cameras share these tables and no other code with the drivers.
"""

from enum import IntEnum

# USB still-image class 1.0 (PIMA 15740 over USB): container header, parameters, interface class.
HEADER_BYTES = 12
UNKNOWN_LENGTH = 0xFFFFFFFF  # PIMA 15740 over USB: a data phase longer than 4 GiB
MAX_PARAMETERS = 5  # PIMA 15740: of operations and responses
STILL_IMAGE_CLASS = (0x06, 0x01, 0x01)


class ContainerType(IntEnum):
    """Second field of a container."""

    COMMAND = 1
    DATA = 2
    RESPONSE = 3
    EVENT = 4


class ClassRequest(IntEnum):
    """bRequest of the class-specific control transfers that we use."""

    CANCEL = 0x64
    DEVICE_RESET = 0x66
    GET_DEVICE_STATUS = 0x67


class Operation(IntEnum):
    """Standard operations."""

    GET_DEVICE_INFO = 0x1001
    OPEN_SESSION = 0x1002
    CLOSE_SESSION = 0x1003
    GET_STORAGE_IDS = 0x1004
    GET_STORAGE_INFO = 0x1005
    GET_NUM_OBJECTS = 0x1006
    GET_OBJECT_HANDLES = 0x1007
    GET_OBJECT_INFO = 0x1008
    GET_OBJECT = 0x1009
    GET_THUMB = 0x100A
    DELETE_OBJECT = 0x100B
    INITIATE_CAPTURE = 0x100E
    POWER_DOWN = 0x1013
    GET_DEVICE_PROP_DESC = 0x1014
    GET_DEVICE_PROP_VALUE = 0x1015
    SET_DEVICE_PROP_VALUE = 0x1016
    RESET_DEVICE_PROP_VALUE = 0x1017
    GET_PARTIAL_OBJECT = 0x101B


class Response(IntEnum):
    """Standard response codes."""

    UNDEFINED = 0x2000
    OK = 0x2001
    GENERAL_ERROR = 0x2002
    SESSION_NOT_OPEN = 0x2003
    INVALID_TRANSACTION_ID = 0x2004
    OPERATION_NOT_SUPPORTED = 0x2005
    PARAMETER_NOT_SUPPORTED = 0x2006
    INCOMPLETE_TRANSFER = 0x2007
    INVALID_STORAGE_ID = 0x2008
    INVALID_OBJECT_HANDLE = 0x2009
    DEVICE_PROP_NOT_SUPPORTED = 0x200A
    INVALID_OBJECT_FORMAT = 0x200B
    STORE_FULL = 0x200C
    OBJECT_WRITE_PROTECTED = 0x200D
    STORE_READ_ONLY = 0x200E
    ACCESS_DENIED = 0x200F
    NO_THUMBNAIL = 0x2010
    SELF_TEST_FAILED = 0x2011
    PARTIAL_DELETION = 0x2012
    STORE_NOT_AVAILABLE = 0x2013
    SPEC_BY_FORMAT_UNSUPPORTED = 0x2014
    NO_VALID_OBJECT_INFO = 0x2015
    INVALID_CODE_FORMAT = 0x2016
    UNKNOWN_VENDOR_CODE = 0x2017
    CAPTURE_ALREADY_TERMINATED = 0x2018
    DEVICE_BUSY = 0x2019
    INVALID_PARENT = 0x201A
    INVALID_PROP_FORMAT = 0x201B
    INVALID_PROP_VALUE = 0x201C
    INVALID_PARAMETER = 0x201D
    SESSION_ALREADY_OPEN = 0x201E
    TRANSACTION_CANCELLED = 0x201F
    DESTINATION_UNSUPPORTED = 0x2020
    INVALID_ENUM_HANDLE = 0x2021
    NO_STREAM_ENABLED = 0x2022
    INVALID_DATASET = 0x2023


class Event(IntEnum):
    """Standard events that our cameras use."""

    CANCEL_TRANSACTION = 0x4001
    OBJECT_ADDED = 0x4002
    OBJECT_REMOVED = 0x4003
    DEVICE_PROP_CHANGED = 0x4006
    STORE_FULL = 0x400A
    STORAGE_INFO_CHANGED = 0x400C
    CAPTURE_COMPLETE = 0x400D


class Prop(IntEnum):
    """Standard device properties that our cameras use."""

    BATTERY_LEVEL = 0x5001
    FUNCTIONAL_MODE = 0x5002
    IMAGE_SIZE = 0x5003
    WHITE_BALANCE = 0x5005
    F_NUMBER = 0x5007
    EXPOSURE_PROGRAM_MODE = 0x500E
    EXPOSURE_INDEX = 0x500F
    EXPOSURE_BIAS = 0x5010
    DATE_TIME = 0x5011
    CAPTURE_DELAY = 0x5012
    STILL_CAPTURE_MODE = 0x5013
    TIMELAPSE_NUMBER = 0x501A
    TIMELAPSE_INTERVAL = 0x501B
    AUDIO_VOLUME = 0x502C


class ObjectFormat(IntEnum):
    """Object formats that our cameras use."""

    ASSOCIATION = 0x3001
    EXIF_JPEG = 0x3801
    DNG = 0x3811
    CANON_CRW = 0xB101
    CANON_CR2 = 0xB103


class DataType(IntEnum):
    """Datatypes of device properties; an array type is ``ARRAY | element``."""

    INT8 = 0x0001
    UINT8 = 0x0002
    INT16 = 0x0003
    UINT16 = 0x0004
    INT32 = 0x0005
    UINT32 = 0x0006
    INT64 = 0x0007
    UINT64 = 0x0008
    INT128 = 0x0009
    UINT128 = 0x000A
    ARRAY = 0x4000
    STRING = 0xFFFF


class FormFlag(IntEnum):
    """Form of a DevicePropDesc."""

    NONE = 0
    RANGE = 1
    ENUMERATION = 2
