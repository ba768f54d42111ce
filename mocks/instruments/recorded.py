"""Recordings of real cameras (``recordings/*.toml``): facts from public dumps; simulated cameras are made of them.

A recording says where its facts come from, and under ``inferred`` which of them are not recorded. Codes are hex, with
runs as ``1001..1003``. Events of a Canon stand one after the other, between ``;``, numbers in hex, with runs as
``from..to/step``::

    D105 = 2                    C189, a number
    D1A0 = words 38 1 2 ...     C189, a structure of u32 (``bytes``: of another length, as hex)
    D102 : 3 37 : 10 13 15 ...  C18A: form, count, the list as u32
    C1A4 ! 20001                another record and its u32
"""

import re
import struct
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from drivers.canon_5d2.codes import CanonEvent
from mocks.instruments.ptp.wire import DeviceIdentity

FOLDER = Path(__file__).parent / "recordings"
EVENT = re.compile(r"\s*([0-9A-F]{4}) ([=:!]) ?([^;]*)")


@dataclass(frozen=True)
class RecordedEvent:
    """One record of a GetEvent stream: its code and payload; ``prop`` and ``body`` of those about a property."""

    code: int
    payload: bytes

    @property
    def prop(self) -> int:
        """The property (C189, C18A)."""
        return int.from_bytes(self.payload[:4], "little")

    @property
    def body(self) -> bytes:
        """The value (C189), or form, count and list (C18A)."""
        return self.payload[4:]

    def encode(self) -> bytes:
        """Return the record as it stands in the stream."""
        return struct.pack("<II", 8 + len(self.payload), self.code) + self.payload


@dataclass(frozen=True)
class Recording:
    """What one real camera said of itself. ``raw``: the whole file."""

    name: str
    raw: Mapping[str, Any]
    events: tuple[RecordedEvent, ...] = field(default=())

    def identity(
        self, *, version: str, serial: str, interrupt_packet_bytes: int, serial_on_usb: bool
    ) -> DeviceIdentity:
        """Return the camera's USB identity and DeviceInfo, with a firmware and a serial number put in."""
        info = self.raw["device_info"]
        return DeviceIdentity(
            usb_id=tuple(self.raw["usb_id"]),
            endpoints=tuple(self.raw["endpoints"]),
            interrupt_packet_bytes=interrupt_packet_bytes,
            vendor_extension=tuple(info["vendor_extension"]),
            manufacturer=info["manufacturer"],
            model=info["model"],
            version=version or info["version"],
            serial=serial,
            serial_on_usb=serial_on_usb,
            **{name: self.codes(name) for name in CODE_LISTS},
        )

    def codes(self, name: str, where: str = "device_info") -> tuple[int, ...]:
        """Return one of the lists of DeviceInfo (see `CODE_LISTS`), or of a Canon's ``device_info_ex``."""
        return tuple(_numbers(self.raw.get(where, {}).get(name, "")))

    def stream(self, which: str = "first") -> tuple[RecordedEvent, ...]:
        """Return a recorded answer to GetEvent, in its order; empty where there is none."""
        return tuple(_events(self.raw.get("events", {}).get(which, "")))

    def dial_at_m(self) -> dict[int, tuple[int, ...]]:
        """Return the lists of the same body with its mode dial at M, where they come from elsewhere."""
        return {int(prop, 16): tuple(_numbers(text)) for prop, text in self.raw.get("dial_at_m", {}).items()}


CODE_LISTS = ("operations", "events", "properties", "capture_formats", "image_formats")


@cache
def recording(name: str) -> Recording:
    """Return the recording of a body, by the name of its file."""
    raw = tomllib.loads((FOLDER / f"{name}.toml").read_text("utf-8"))
    return Recording(name, raw, tuple(_events(raw.get("events", {}).get("first", ""))))


def recorded_bodies(kind: str) -> list[str]:
    """Return the names of all recordings of a kind (canon, theta)."""
    return [name for name in sorted(p.stem for p in FOLDER.glob("*.toml")) if recording(name).raw["kind"] == kind]


def _numbers(text: str) -> Iterator[int]:
    for word in text.split():
        first, _, rest = word.partition("..")
        last, _, step = (rest or first).partition("/")
        yield from range(int(first, 16), int(last, 16) + 1, int(step or "1", 16))


def _events(text: str) -> Iterator[RecordedEvent]:
    for part in filter(str.strip, re.sub(r"\n(?! )", " ; ", text).split(";")):
        found = EVENT.fullmatch(part.replace("\n", " ").rstrip())
        if found is None:
            raise ValueError(f"{part!r} is no recorded event")
        code, sign, rest = int(found[1], 16), found[2], found[3]
        if sign == "=":
            yield RecordedEvent(CanonEvent.PROP_VALUE_CHANGED, struct.pack("<I", code) + _value(rest))
        elif sign == ":":
            head, _, words = rest.partition(":")
            yield RecordedEvent(CanonEvent.AVAIL_LIST_CHANGED, _pack([code, *_numbers(head), *_numbers(words)]))
        else:
            yield RecordedEvent(code, _pack(list(_numbers(rest))))


def _value(text: str) -> bytes:
    kind, _, rest = text.strip().partition(" ")
    if kind == "bytes":
        return bytes.fromhex(rest)
    return _pack(list(_numbers(rest if kind == "words" else text)))


def _pack(words: list[int]) -> bytes:
    return struct.pack(f"<{len(words)}I", *words)
