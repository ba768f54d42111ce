"""A serial port with an instrument behind it: a pseudo-terminal, as a cable to a meter would be."""

import os
import select
import tempfile
import threading
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from drivers.clock import Clock, SystemClock

MAX_QUESTION_BYTES = 256  # chosen: more without a line end is thrown away, as a small buffer does


@dataclass(frozen=True)
class Piece:
    """Bytes that leave the meter ``after_s`` seconds after the question; None in place of bytes: the plug is out."""

    after_s: float
    data: bytes | None


class Instrument(Protocol):
    """Anything that answers lines, as `mocks.instruments.ls160.SimulatedMeter` does."""

    line_end: bytes
    """What ends a question."""

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        """Return the timed answer to one question."""


class SerialPort:
    """A pseudo-terminal with an instrument behind it; open ``name`` with pyserial. Close it when done.

    ``instrument``: who answers.
    ``stable_name``: A symbolic link that is kept on the current pseudo-terminal, as the system's by-id names are.
    """

    def __init__(self, instrument: Instrument, clock: Clock | None = None, stable_name: Path | None = None) -> None:
        self._instrument = instrument
        self._clock = clock or SystemClock()
        self._start_s = self._clock.monotonic_s()
        self._stable_name = stable_name
        self._plug: _Plug | None = None
        self.name = ""
        self.replug()

    def replug(self) -> None:
        """Pull the plug and put it in again: the port has another name then."""
        before, self._plug = self._plug, _Plug(self._answer, self._instrument.line_end)
        if before is not None:
            before.pull()
        self.name = self._plug.name
        if self._stable_name is not None:
            self._stable_name.unlink(missing_ok=True)
            self._stable_name.symlink_to(self.name)

    def inject(self, data: bytes) -> None:
        """Let bytes come that nobody asked for."""
        assert self._plug is not None
        self._plug.send(data)

    def close(self) -> None:
        """Unplug for good; may be called twice."""
        if self._plug is not None:
            self._plug.pull()

    def _answer(self, line: bytes, plug: "_Plug") -> None:
        """Send the timed pieces."""
        asked_s = self._clock.monotonic_s()
        for piece in self._instrument.hear(line, asked_s - self._start_s):
            wait_s = asked_s + piece.after_s - self._clock.monotonic_s()
            while wait_s > 0 and not plug.pulled.is_set():
                self._clock.sleep(min(wait_s, 0.1))
                wait_s = asked_s + piece.after_s - self._clock.monotonic_s()
            if piece.data is None:
                plug.pull()
            if plug.pulled.is_set():
                return
            plug.send(piece.data or b"")


class _Plug:
    """One pseudo-terminal and the thread behind it."""

    def __init__(self, answer: "Callable[[bytes, _Plug], None]", line_end: bytes) -> None:
        self._answer, self._line_end = answer, line_end
        self._master, self._slave = os.openpty()
        # Raw: bytes pass as on a wire. The slave stays open here, so that the master lives while nobody listens.
        tty.setraw(self._slave)
        # A name of its own, gone before the line is: the system gives a free number to whoever asks next, and a
        # driver that opens its line anew would find another program's instrument behind it.
        self._home = tempfile.TemporaryDirectory(prefix="daylit-port-")
        self.name = str(Path(self._home.name) / "ttyMETER")
        Path(self.name).symlink_to(os.ttyname(self._slave))
        self.pulled = threading.Event()
        self._pulling = threading.Lock()
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="meter-port", daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Put bytes on the wire; what finds no room within a second is lost."""
        while data and select.select([], [self._master], [], 1.0)[1]:
            data = data[os.write(self._master, data[:512]) :]

    def pull(self) -> None:
        """End the line: who has it open gets an error. May be called twice, and from the thread itself."""
        with self._pulling:
            if not self.pulled.is_set():
                self._home.cleanup()
                os.write(self._wake_write, b"x")  # first: once it is pulled, the thread closes the pipe
                self.pulled.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(5)

    def _serve(self) -> None:
        heard = bytearray()
        while not self.pulled.is_set():
            ready, _, _ = select.select([self._master, self._wake_read], [], [])
            if self._master in ready:
                heard += os.read(self._master, 4096)
            while self._line_end in heard and not self.pulled.is_set():
                line, _, rest = bytes(heard).partition(self._line_end)
                heard = bytearray(rest)
                self._answer(line, self)
            del heard[:-MAX_QUESTION_BYTES]
        for fd in (self._master, self._slave, self._wake_read, self._wake_write):
            with suppress(OSError):
                os.close(fd)
