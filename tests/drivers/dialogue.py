"""Writes scripts for `ScriptedTransport`: one call an operation, transaction ids counted; bytes by `struct` alone."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Self

from tests.drivers.scripted import (
    Answer,
    FakeClock,
    OnEvent,
    ScriptedTransport,
    Step,
    command,
    data,
    event,
    response,
)

OK = 0x2001
BUSY = 0x2019


def ptp_string(text: str) -> bytes:
    return bytes([len(text) + 1]) + (text + "\0").encode("utf-16-le") if text else b"\0"


def u16_array(values: Sequence[int]) -> bytes:
    return struct.pack(f"<I{len(values)}H", len(values), *values)


def u32_array(values: Sequence[int]) -> bytes:
    return struct.pack(f"<I{len(values)}I", len(values), *values)


def device_info(extension: int, operations: Sequence[int], properties: Sequence[int], texts: Sequence[str]) -> bytes:
    lists = b"".join(map(u16_array, (operations, (0x4002,), properties, (), (0x3801,))))
    return (
        struct.pack("<HIH", 100, extension, 110)
        + b"\0"
        + struct.pack("<H", 0)
        + lists
        + b"".join(map(ptp_string, texts))
    )


def object_info(name: str, format_code: int, size: int, *, storage: int = 0x00020001) -> bytes:
    fixed = struct.pack("<IHHIHIIIIIIIHII", storage, format_code, 0, size, 0x3801, 0, 0, 0, 0, 0, 24, 0, 0, 0, 0)
    return fixed + ptp_string(name) + ptp_string("20230519T155400") + b"\0\0"


def enumeration(prop: int, data_type: int, item: str, values: Sequence[int], *, current: int | None = None) -> bytes:
    """A DevicePropDesc with a list; ``item`` is the struct letter of its type."""
    now = values[0] if current is None else current
    head = struct.pack(f"<HHB{item}{item}B", prop, data_type, 1, values[0], now, 2)
    return head + struct.pack(f"<H{len(values)}{item}", len(values), *values)


class Dialogue:
    """A script under construction; `last_id` is the transaction id of the operation written last."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.last_id = 0

    def open(self) -> Self:
        self.last_id = 0
        self.steps.append(Step(command(0x1002, 0, 1), [response(OK, 0)]))
        return self

    def ask(
        self,
        code: int,
        *params: int,
        gives: bytes | None = None,
        sends: bytes | None = None,
        answer: int = OK,
        results: Sequence[int] = (),
    ) -> Self:
        """One operation: what it sends, or is given, and how it is answered."""
        self.last_id += 1
        answers: list[Answer] = [] if gives is None else [data(code, self.last_id, gives)]
        answers.append(response(answer, self.last_id, *results))
        if sends is None:
            self.steps.append(Step(command(code, self.last_id, *params), answers))
        else:
            self.steps.append(Step(command(code, self.last_id, *params)))
            self.steps.append(Step(data(code, self.last_id, sends), answers))
        return self

    def event(self, code: int, *params: int, transaction_id: int | None = None) -> Self:
        """An event that comes with the answer of the last operation; its own id is that operation's."""
        number = self.last_id if transaction_id is None else transaction_id
        last = self.steps[-1]
        self.steps[-1] = Step(last.sent, [*last.answers, OnEvent(event(code, number, *params))], last.raises)
        return self

    def transport(self, clock: FakeClock) -> ScriptedTransport:
        return ScriptedTransport(self.steps, clock=clock)
