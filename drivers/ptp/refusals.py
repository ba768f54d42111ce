"""What a camera's refusal means, in words: response codes to typed errors."""

from __future__ import annotations

from drivers.errors import DeviceBusyError, DeviceError, OperationRefusedError, StoreFullError
from drivers.ptp.codes import Operation, Response

STORE_CODES = frozenset({Response.STORE_FULL, Response.STORE_READ_ONLY, Response.STORE_NOT_AVAILABLE})

_LIKELY: dict[int, tuple[str, str]] = {
    Response.STORE_FULL: ("the card is full", "empty the card or put in another, then resume"),
    Response.STORE_READ_ONLY: ("the card is write-protected", "unlock the card, then resume"),
    Response.STORE_NOT_AVAILABLE: ("there is no card, or its door is open", "put in a card and close the door"),
    Response.DEVICE_BUSY: ("it is saving a picture, asleep, or in a menu", "wait, or wake it"),
    Response.ACCESS_DENIED: ("another program or the camera's own menu has it", "close other photo programs"),
    Response.SESSION_NOT_OPEN: ("the camera was switched off and on", "resynchronise"),
    Response.INVALID_TRANSACTION_ID: ("an earlier command never reached the camera", "resynchronise"),
}


def operation_name(operation: int) -> str:
    """Return ``GetObject 1009`` style names for standard operations, hex for others."""
    try:
        words = Operation(operation).name.title().replace("_", "")
    except ValueError:
        return f"operation {operation:04X}"
    return f"{words} {operation:04X}"


def response_name(code: int) -> str:
    """Return the name of a response code in words, with the code in hex."""
    try:
        return f"{Response(code).name.lower().replace('_', ' ')} ({code:04X})"
    except ValueError:
        return f"response {code:04X}"


def refusal(operation: int, code: int, params: tuple[int, ...] = (), *, where: str = "") -> DeviceError:
    """Return the error for a response that the caller did not want."""
    likely, advice = _LIKELY.get(code, ("", ""))
    message = f"{operation_name(operation)} was answered with: {response_name(code)}"
    facts = {"operation": operation, "params": list(params)}
    if code == Response.DEVICE_BUSY:
        return DeviceBusyError(message, where=where, likely=likely, advice=advice, response_code=code, **facts)
    if code in STORE_CODES:
        return StoreFullError(message, where=where, likely=likely, advice=advice, response_code=code, **facts)
    return OperationRefusedError(message, where=where, likely=likely, advice=advice, response_code=code, **facts)
