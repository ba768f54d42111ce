"""Transcripts: every byte between computer and instruments, with times, as JSON lines that can be sent in and replayed.

A line: ``{"t": seconds, "who": "outdoor", "way": "out", "hex": "..."}``; ``t`` is monotonic, from the transcript's
beginning. Ways of a camera: out, in, event, control_out, control_in, clear_halt, reset, open, close; of a serial line:
open, out, in, drain, close. A call that failed has ``"error"`` with its code; what else is worth knowing is in
``"info"``. A file whose name ends in ``.gz`` is compressed.
"""

import gzip
import json
import threading
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, Any, TypeVar

from drivers.clock import Clock
from drivers.errors import DeviceError, ProtocolViolationError
from drivers.ptp.pipes import Pipe, PtpTransport
from drivers.serial_link import ByteLine

MAX_LINE_BYTES = 4 * 1024 * 1024
"""Of a transcript that is read: one transfer of 512 KiB in hex, with room (`drivers.ptp.pipes.MAX_READ_BYTES`)."""

T = TypeVar("T")


@dataclass(frozen=True)
class Entry:
    """One thing that went over a link. ``t_s``: from the transcript's beginning; ``error``: code of a failed call."""

    t_s: float
    who: str
    way: str
    data: bytes = b""
    error: str = ""
    info: dict[str, Any] = field(default_factory=dict)


class Transcript:
    """Writes a transcript; safe to share between threads. Each line is on disk when the call returns."""

    def __init__(self, file: IO[str], clock: Clock) -> None:
        self._file = file
        self._clock = clock
        self._start_s = clock.monotonic_s()
        self._lock = threading.Lock()
        self.problem: OSError | None = None
        """Why nothing more is written: a full disk costs the transcript, and not what the instruments do."""

    def write(
        self, who: str, way: str, data: bytes = b"", *, error: str = "", info: dict[str, Any] | None = None
    ) -> None:
        """Write one entry, dated now."""
        line: dict[str, Any] = {"t": 0.0, "who": who, "way": way}
        line |= {k: v for k, v in (("hex", data.hex()), ("error", error), ("info", info)) if v}
        with self._lock:
            line["t"] = round(self._clock.monotonic_s() - self._start_s, 6)
            try:
                if self.problem is None:
                    print(json.dumps(line), file=self._file, flush=True)
            except OSError as error:
                self.problem = error

    def call(self, who: str, way: str, call: Callable[[], T], *, sent: bytes = b"") -> T:
        """Make a call on a link and write what was sent, or what came, or how it failed."""
        try:
            result = call()
        except DeviceError as error:
            self.write(who, way, sent, error=error.code)
            raise
        if way != "event" or result is not None:  # polled many times a second: written only where something came
            self.write(who, way, result if isinstance(result, bytes) else sent)
        return result


def read_transcript(path: Path) -> Iterator[Entry]:
    """Yield the entries of a transcript, as far as it goes; `ProtocolViolationError` names the line that is none."""
    number = 0
    try:
        with gzip.open(path, "rt", encoding="utf-8") if path.suffix == ".gz" else path.open(encoding="utf-8") as file:
            while line := file.readline(MAX_LINE_BYTES):
                number += 1
                yield _entry(line)
    except EOFError:
        return  # compressed, and the program was killed: every line before was flushed
    except (OSError, zlib.error, ValueError, KeyError, TypeError, RecursionError) as error:
        text = f"line {number} is not a transcript line: {error}"
        text = f"cannot be read: {error}" if isinstance(error, OSError) else text
        advice = "give a file that --record wrote; record it again, or repair the line"
        raise ProtocolViolationError(text, where=str(path), advice=advice) from error


def _entry(line: str) -> Entry:
    raw = json.loads(line)
    t_s, info = float(raw["t"]), dict(raw.get("info", {}))
    return Entry(
        t_s, str(raw["who"]), str(raw["way"]), bytes.fromhex(raw.get("hex", "")), str(raw.get("error", "")), info
    )


class RecordedTransport:
    """A `drivers.ptp.pipes.PtpTransport` that writes down what another one does."""

    def __init__(self, inner: PtpTransport, transcript: Transcript, who: str) -> None:
        self.name = inner.name
        self.max_packet_bytes = inner.max_packet_bytes
        self._inner = inner
        self._call = partial(transcript.call, who)
        transcript.write(who, "open", info={"name": inner.name, "max_packet_bytes": inner.max_packet_bytes})

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send on bulk-out."""
        self._call("out", lambda: self._inner.write(data, timeout_s), sent=data)

    def read(self, max_bytes: int, timeout_s: float) -> bytes:
        """Return one bulk-in transfer."""
        return self._call("in", lambda: self._inner.read(max_bytes, timeout_s))

    def read_event(self, timeout_s: float) -> bytes | None:
        """Return one interrupt transfer or None."""
        return self._call("event", lambda: self._inner.read_event(timeout_s))

    def control_out(self, request: int, data: bytes, timeout_s: float) -> None:
        """Send a class request; its number goes before its data in the transcript."""
        sent = bytes([request]) + data
        self._call("control_out", lambda: self._inner.control_out(request, data, timeout_s), sent=sent)

    def control_in(self, request: int, length: int, timeout_s: float) -> bytes:
        """Return the answer to a class request."""
        return self._call("control_in", lambda: self._inner.control_in(request, length, timeout_s))

    def clear_halt(self, pipe: Pipe) -> None:
        """Clear the halt of one endpoint."""
        self._call("clear_halt", lambda: self._inner.clear_halt(pipe), sent=pipe.encode())

    def reset(self) -> None:
        """Reset the port."""
        self._call("reset", self._inner.reset)

    def reopen(self) -> None:
        """Find and open the instrument anew."""
        self._call("open", self._inner.reopen)

    def close(self) -> None:
        """Release the instrument."""
        self._call("close", self._inner.close)


class RecordedLine:
    """A `drivers.serial_link.ByteLine` that writes down what another does; ``settings``: baud and frame in words."""

    def __init__(self, inner: ByteLine, transcript: Transcript, who: str, settings: str = "") -> None:
        self.name = inner.name
        self._inner = inner
        self._transcript = transcript
        self._who = who
        transcript.write(who, "open", info={"name": inner.name, "settings": settings})

    def write(self, data: bytes, timeout_s: float) -> None:
        """Send all bytes."""
        self._transcript.call(self._who, "out", lambda: self._inner.write(data, timeout_s), sent=data)

    def read_line(self, delimiter: bytes, max_bytes: int, timeout_s: float) -> bytes:
        """Return a line without its delimiter; in the transcript it has it, and what came of an unfinished one."""
        try:
            line = self._inner.read_line(delimiter, max_bytes, timeout_s)
        except DeviceError as error:
            partial = bytes.fromhex(str(error.details.get("partial", "")))
            self._transcript.write(self._who, "in", partial, error=error.code)
            raise
        self._transcript.write(self._who, "in", line + (delimiter if len(line) <= max_bytes else b""))
        return line

    def drain(self, quiet_s: float, limit_s: float) -> int:
        """Throw away what comes."""
        return self._transcript.call(self._who, "drain", lambda: self._inner.drain(quiet_s, limit_s))

    def close(self) -> None:
        """Give the line back."""
        self._transcript.call(self._who, "close", self._inner.close)
