"""Transcripts replayed as instruments (`drivers.transcript`): what was asked then is answered now as it was then.

A replay is no strict order: drivers poll, and time differs. What changes a camera (settings, releases, sessions) moves
the replay on to the next such request of the transcript; questions in between are answered as they were in that place,
or, asked more often than then, as the last time. A camera's events come as long after a request as they did. A request
that the transcript does not have is refused.
"""

import io
import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from drivers.clock import Clock
from drivers.errors import DeviceTimeoutError
from drivers.ptp.codes import HEADER_BYTES, ContainerType, Event, Operation, Response
from drivers.ptp.container import Container, encode
from drivers.ptp.pipes import Pipe
from drivers.transcript import Entry

GET_EVENT = 0x9116  # Canon's, as libgphoto2 numbers it
NO_RECORDS = struct.pack("<II", 8, 0)
QUESTIONS = frozenset(
    {
        *(Operation.GET_DEVICE_INFO, Operation.GET_STORAGE_IDS, Operation.GET_STORAGE_INFO),
        *(Operation.GET_OBJECT_HANDLES, Operation.GET_OBJECT_INFO, Operation.GET_OBJECT, Operation.GET_PARTIAL_OBJECT),
        *(Operation.GET_DEVICE_PROP_DESC, Operation.GET_DEVICE_PROP_VALUE),
        *(GET_EVENT, 0x9107, 0x911C, 0x911D),  # Canon: GetPartialObject, ResetUILock (asks for "busy"), KeepDeviceOn
    }
)
"""Operations that leave a camera as it is, so that they may be asked more or less often than in the transcript."""
STATUS_OK = struct.pack("<HH", 4, Response.OK)  # answer to the class request GetDeviceStatus

Key = tuple[int, tuple[int, ...], bytes]


@dataclass
class Exchange:
    """One transaction: what was asked, the transfers that answered, and the events until the next action."""

    t_s: float
    key: Key
    transaction_id: int
    transfers: list[bytes] = field(default_factory=list)
    events: list[tuple[float, bytes]] = field(default_factory=list)
    used: bool = False

    @property
    def is_question(self) -> bool:
        """Whether the camera stays as it is."""
        return self.key[0] in QUESTIONS


def exchanges(entries: Iterable[Entry]) -> list[Exchange]:
    """Return the transactions of one camera's entries, events at the action before them."""
    found: list[Exchange] = []
    action: Exchange | None = None
    for entry in entries:
        if entry.error or not entry.data:
            continue
        if entry.way == "out" and _is_command(entry.data):
            operation, params, transaction_id = _request(entry.data)
            found.append(Exchange(entry.t_s, (operation, params, b""), transaction_id))
            action = action if found[-1].is_question and action else found[-1]
        elif entry.way == "out" and found:
            operation, params, data = found[-1].key
            found[-1].key = (operation, params, data + entry.data[0 if data else HEADER_BYTES :])
        elif entry.way == "in" and found:
            found[-1].transfers.append(entry.data)
        elif entry.way == "event" and action:
            action.events.append((entry.t_s - action.t_s, entry.data))
    return [e for e in found if e.transfers]


def _is_command(data: bytes) -> bool:
    return data[4:6] == struct.pack("<H", ContainerType.COMMAND)


def _request(data: bytes) -> tuple[int, tuple[int, ...], int]:
    """Return operation, parameters and transaction id of a command."""
    operation, transaction_id = struct.unpack_from("<HI", data, 6)
    return operation, struct.unpack(f"<{(len(data) - HEADER_BYTES) // 4}I", data[HEADER_BYTES:]), transaction_id


def _giving(key: Key, data: bytes) -> Exchange:
    """Return a transaction that gives data, under no id of the transcript."""
    done = Container(ContainerType.RESPONSE, Response.OK, 0, struct.pack("<I", len(data)))
    return Exchange(0.0, key, -1, [encode(Container(ContainerType.DATA, key[0], 0, data)), encode(done)])


class ReplayedTransport:
    """A `drivers.ptp.pipes.PtpTransport` that answers from a transcript. ``unknown`` counts what it does not have."""

    def __init__(self, entries: Iterable[Entry], clock: Clock, name: str) -> None:
        kept = list(entries)
        sizes = [e.info["max_packet_bytes"] for e in kept if e.way == "open" and "max_packet_bytes" in e.info]
        self.name = f"{name} (recorded)"
        self.max_packet_bytes = int(sizes[0]) if sizes else 512
        self.unknown = 0
        self._exchanges = exchanges(kept)
        self._clock = clock
        self._next = 0
        self._asked: tuple[int, tuple[int, ...], int] = (0, (), 0)
        self._sent = b""
        self._answers: deque[bytes] = deque()
        self._events: list[tuple[float, bytes]] = []
        self._ids: dict[int, int] = {}

    def write(self, data: bytes, timeout_s: float) -> None:
        """Take a request, or the data of one."""
        if _is_command(data):
            self._asked, self._sent = _request(data), b""
            self._answers.clear()
            if not any(e.key[:2] == self._asked[:2] and e.key[2] for e in self._exchanges):
                self._answer(b"")
        elif data:
            self._sent += data[0 if self._sent else HEADER_BYTES :]
            self._answer(self._sent)

    def _answer(self, sent: bytes) -> None:
        operation, params, number = self._asked
        found = self._find((operation, params, sent))
        if found is None:
            self.unknown += 1
            self._answers.append(encode(Container(ContainerType.RESPONSE, Response.INVALID_PARAMETER, number)))
            return
        found.used = True
        self._ids[found.transaction_id] = number
        self._answers.extend(_with_id(found.transfers, number))
        if not found.is_question:
            now_s = self._clock.monotonic_s()
            self._events += [(now_s + after_s, data) for after_s, data in found.events]

    def _find(self, key: Key) -> Exchange | None:
        here = self._exchanges[self._next :]
        if key[0] not in QUESTIONS:
            at = next((n for n, e in enumerate(here) if e.key == key), None)
            if at is not None:
                self._next += at + 1
                return here[at]
        before = self._exchanges[: self._next]
        window = here[: next((n for n, e in enumerate(here) if not e.is_question), len(here))]
        if key[0] == GET_EVENT:  # none may be lost, none comes twice
            unheard = (e for e in (*before, *window) if e.key == key and not e.used)
            return next(unheard, _giving(key, NO_RECORDS))
        places = ([e for e in window if not e.used], [*before, *window][::-1], here)
        found = next((e for place in places for e in place if e.key == key), None)
        return self._part(key) if found is None and key[0] in (Operation.GET_PARTIAL_OBJECT, 0x9107) else found

    def _part(self, key: Key) -> Exchange | None:
        """Return a part of a picture, put together from the pieces in which it was fetched: those go by the moment."""
        operation, (handle, offset, size), _ = key
        picture = bytearray()
        pieces = (e for e in self._exchanges if e.key[0] == operation and e.key[1][0] == handle)
        for piece in sorted(pieces, key=lambda e: e.key[1][1]):
            at, raw = piece.key[1][1], b"".join(piece.transfers)
            data = raw[HEADER_BYTES : int.from_bytes(raw[:4], "little")]  # none where it was refused
            if at <= len(picture) < at + len(data):
                picture[at:] = data
        part = bytes(picture[offset : offset + size])
        return _giving(key, part) if part else None

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next transfer of the answer."""
        if not self._answers:
            self._clock.sleep(timeout_s)
            raise DeviceTimeoutError("the transcript has nothing more to answer", where=self.name, limit_s=timeout_s)
        data = self._answers.popleft()
        if len(data) > max_bytes:
            self._answers.appendleft(data[max_bytes:])
        return data[:max_bytes]

    def read_event(self, timeout_s: float) -> bytes | None:
        """Return the next event that is due within ``timeout_s``, or None."""
        if not self._events or self._events[0][0] > self._clock.monotonic_s() + timeout_s:
            self._clock.sleep(timeout_s)
            return None
        due_s, data = self._events.pop(0)
        self._clock.sleep(max(0.0, due_s - self._clock.monotonic_s()))
        # An event with transaction ids as they are now: in its header, and as the parameter that one has
        if len(data) < HEADER_BYTES:
            return data
        code, transaction_id = struct.unpack_from("<HI", data, 6)
        rest = data[HEADER_BYTES:]
        if code == Event.CAPTURE_COMPLETE and len(rest) == 4:
            (number,) = struct.unpack("<I", rest)
            rest = struct.pack("<I", self._ids.get(number, number))
        return data[:8] + struct.pack("<I", self._ids.get(transaction_id, transaction_id)) + rest

    def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
        """Do nothing: a replay is never out of step."""

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        """Return that all is well."""
        return STATUS_OK[:length]

    def clear_halt(self, pipe: Pipe) -> None:
        """Do nothing: no endpoint halts."""

    def reset(self) -> None:
        """Forget answers under way."""
        self._answers.clear()

    def reopen(self) -> None:
        """Go on where the replay stands."""
        self._answers.clear()

    def close(self) -> None:
        """Do nothing: the same instrument can be opened again."""


def _with_id(transfers: list[bytes], transaction_id: int) -> list[bytes]:
    """Return the transfers with another transaction id in each of their containers."""
    whole, at = bytearray(b"".join(transfers)), 0
    while at + HEADER_BYTES <= len(whole):
        (length,) = struct.unpack_from("<I", whole, at)
        struct.pack_into("<I", whole, at + 8, transaction_id)
        at += max(length, HEADER_BYTES)
    renumbered = io.BytesIO(whole)
    return [renumbered.read(len(transfer)) for transfer in transfers]


class ReplayedLine:
    """A `drivers.serial_link.ByteLine` that answers from a transcript, as long after a request as it did."""

    def __init__(self, entries: Iterable[Entry], clock: Clock, name: str) -> None:
        self.name = f"{name} (recorded)"
        self._entries = [e for e in entries if e.way in ("out", "in") and (e.data or e.error)]
        self._clock = clock
        self._next = 0
        self._coming: deque[tuple[float, bytes]] = deque()
        self._buffer = b""

    def write(self, data: bytes, timeout_s: float) -> None:
        """Take a request: the next such one of the transcript answers, or the last before; another gets no answer."""
        asked = [n for n, e in enumerate(self._entries) if e.way == "out" and e.data == data]
        if not asked:
            return
        at = next((n for n in asked if n >= self._next), asked[-1])
        start_s, now_s = self._entries[at].t_s, self._clock.monotonic_s()
        self._next = at + 1
        for entry in self._entries[at + 1 :]:
            if entry.way == "out":
                break
            self._next += 1
            self._coming.append((now_s + entry.t_s - start_s, entry.data))

    def read_line(self, delimiter: bytes, max_bytes: int, timeout_s: float) -> bytes:
        """Return the next line without its delimiter; `DeviceTimeoutError` where none is due in time."""
        end_s = self._clock.monotonic_s() + timeout_s
        while delimiter not in self._buffer and len(self._buffer) <= max_bytes:
            if not self._coming or self._coming[0][0] > end_s:
                self._clock.sleep(max(0.0, end_s - self._clock.monotonic_s()))
                partial, self._buffer = self._buffer.hex(), b""
                text = f"no complete line within {timeout_s:g} s"
                raise DeviceTimeoutError(text, where=self.name, partial=partial, limit_s=timeout_s)
            due_s, data = self._coming.popleft()
            self._clock.sleep(max(0.0, due_s - self._clock.monotonic_s()))
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(delimiter)
        return line[: max_bytes + 1]

    def drain(self, quiet_s: float, limit_s: float) -> int:
        """Throw away what is due."""
        self._clock.sleep(quiet_s)
        now_s, dropped = self._clock.monotonic_s(), len(self._buffer)
        self._buffer = b""
        while self._coming and self._coming[0][0] <= now_s:
            dropped += len(self._coming.popleft()[1])
        return dropped

    def close(self) -> None:
        """Do nothing: the same meter can be opened again."""
