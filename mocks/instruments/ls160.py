"""The simulated luminance meter: what it hears, what it says, and how it may misbehave.

Written from the instruments' manuals, not from the dialect files that it is to test. A meter takes bytes and gives
back timed pieces of bytes, so that the same instrument serves a pseudo-terminal and a line in memory.
"""

from __future__ import annotations

import math
import os
import random
import select
import threading
import tty
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Protocol

from drivers.clock import Clock, SystemClock


class MeterFaultKind(StrEnum):
    """Ways to spoil one answer."""

    GARBLE_BYTE = "garble_byte"
    DROP_BYTE = "drop_byte"
    PARTIAL = "partial"
    JOINED = "joined"
    NULS = "nuls"
    ECHO = "echo"
    FLOOD = "flood"
    OVER_RANGE = "over_range"
    ERROR_CODE = "error_code"
    UNIT_FL = "unit_fl"
    PER_CENT = "per_cent"
    PEAK = "peak"
    BATTERY_LOW = "battery_low"
    FROZEN = "frozen"
    NO_ANSWER = "no_answer"
    LATE = "late"
    """The meter is busy for so long, and hears nothing meanwhile."""
    LAGGING = "lagging"
    """The adapter holds the answer back, and all later ones behind it; questions get through."""
    UNPLUG = "unplug"


TOP_CD_M2 = {"ls100": 299_900.0, "cs100a": 299_000.0, "ls160": 9_999_000.0}
"""Above this a meter says that it is out of range (data sheets, from memory)."""


@dataclass(frozen=True)
class MeterFault:
    """Spoil the answers number ``first`` to ``last`` (from 1, of measurements only)."""

    kind: MeterFaultKind
    first: int = 1
    last: int = 1_000_000
    seconds: float = 8.0
    """How late a late or lagging answer is."""

    def hits(self, number: int) -> bool:
        """Whether this measurement is spoiled."""
        return self.first <= number <= self.last


@dataclass(frozen=True)
class Piece:
    """Bytes that leave the meter ``after_s`` seconds after the question; None in place of bytes: the plug is out."""

    after_s: float
    data: bytes | None


class SimulatedMeter:
    """A meter that looks at a luminance.

    ``luminance_cd_m2``: what it looks at, as a function of seconds since it was made.
    ``language``: ``"ls100"`` (MES; deaf while it measures), ``"cs100a"`` (likewise), or ``"ls160"`` (the assumed
      RMT/MES/MDR).
    ``noise_frac``: standard deviation of one reading, relative.
    ``measuring_s``: time of one measurement.
    """

    def __init__(
        self,
        luminance_cd_m2: Callable[[float], float],
        *,
        language: str = "ls100",
        noise_frac: float = 1e-3,
        measuring_s: float = 0.4,
        faults: tuple[MeterFault, ...] = (),
        seed: int = 0,
    ) -> None:
        self._luminance = luminance_cd_m2
        self._language = language
        self._noise_frac = noise_frac
        self.measuring_s = measuring_s
        self._faults = faults
        self._random = random.Random(seed)
        self._held: bytes | None = None
        self._measured_at_s = self._lag_s = 0.0
        self._remote = False
        self._last_number = ""
        self._busy_until_s = self._sent_until_s = float("-inf")
        self.n_measured = 0
        self.shown: list[str] = []
        """The number of each measurement as its display showed it, for tests."""

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        """Return the answer to one question (without its line end); nothing from a meter that is busy."""
        if now_s < self._busy_until_s:
            return []
        answers = {"ls100": self._ls100, "cs100a": self._cs100a, "ls160": self._ls160}
        pieces = answers[self._language](line.decode("ascii", "replace").strip("\0"), now_s)
        ready_s = self._sent_until_s - now_s  # one wire: nothing overtakes
        pieces = [Piece(max(p.after_s, ready_s), p.data) for p in pieces]
        if pieces:
            self._sent_until_s = now_s + pieces[-1].after_s
        return pieces

    def _ls100(self, text: str, now_s: float) -> list[Piece]:
        if text == "MES":
            return self._measured(now_s, lambda number: f"OK00,CcPH{number:>6}")
        if text == "DSR":
            return [Piece(0.05, self._held or b"ER00\r\n")]
        if text.startswith("MDS,") and text[4:].isdigit() and int(text[4:]) <= 9:
            return [Piece(0.05, b"OK00\r\n")]
        if text == "CLE":
            return [Piece(0.05, b"OK00\r\n")]
        return [Piece(0.05, b"ER00\r\n")]

    def _cs100a(self, text: str, now_s: float) -> list[Piece]:
        if text == "MES":
            return self._measured(now_s, lambda number: f"OK00,{number:>6}, .3127, .3290")
        return [Piece(0.05, b"OK00\r\n" if text.startswith("MDS,") else b"ER00\r\n")]

    def _ls160(self, text: str, now_s: float) -> list[Piece]:
        if text in ("RMT,1", "RMT,0"):
            self._remote = text == "RMT,1"
            return [Piece(0.02, b"OK00\r\n")]
        if not self._remote:
            return [Piece(0.02, b"ER00\r\n")]
        if text == "MES,1":
            return self._ls160_measured(now_s)
        if text == "MDR,0":
            if now_s < self._measured_at_s:
                return [Piece(0.02, b"ER20\r\n")]
            return [Piece(0.02 + self._lag_s, self._held)] if self._held else []
        return [Piece(0.02, b"ER00\r\n")]

    def _ls160_measured(self, now_s: float) -> list[Piece]:
        """Measure in the background: the answer says how long that takes; the data stay until the next time."""
        pieces = self._measured(now_s, lambda number: f"OK00,0,{number:>9}")
        self._busy_until_s = float("-inf")
        if pieces and pieces[-1].data is None:
            return pieces
        self._held = pieces[-1].data if pieces else None
        self._lag_s = pieces[-1].after_s - self.measuring_s if pieces else 0.0
        self._measured_at_s = now_s + self.measuring_s
        return [Piece(0.02, f"OK00,{self.measuring_s:4.1f}\r\n".encode())]

    def _measured(self, now_s: float, line: Callable[[str], str]) -> list[Piece]:
        self.n_measured += 1
        fault = next((f for f in self._faults if f.hits(self.n_measured)), None)
        number = self._number(now_s)
        if fault is not None and fault.kind is MeterFaultKind.FROZEN and self._last_number:
            number = self._last_number
        self._last_number = number
        self.shown.append(number)
        over = float(number) > TOP_CD_M2[self._language]
        answer = b"ER10\r\n" if over else (line(number) + "\r\n").encode()
        self._held = answer
        pieces = [Piece(self.measuring_s, answer)] if fault is None else self._spoil(fault, answer)
        late_s = fault.seconds if fault is not None and fault.kind is MeterFaultKind.LATE else 0.0
        self._busy_until_s = now_s + self.measuring_s + late_s
        return pieces

    def _number(self, now_s: float) -> str:
        """Return the luminance as the display shows it: four significant digits, at most two decimals."""
        value = self._luminance(now_s) * (1 + self._random.gauss(0, self._noise_frac))
        if value <= 0:
            return "0.00"
        decimals = min(2, max(0, 3 - math.floor(math.log10(value))))
        text = f"{value:.{decimals}f}"
        return text if decimals else f"{float(f'{value:.4g}'):.0f}"

    def _spoil(self, fault: MeterFault, answer: bytes) -> list[Piece]:
        after_s = self.measuring_s
        kind = fault.kind
        if kind is MeterFaultKind.NO_ANSWER:
            return []
        if kind is MeterFaultKind.UNPLUG:
            return [Piece(after_s / 2, None)]
        if kind in (MeterFaultKind.LATE, MeterFaultKind.LAGGING):
            return [Piece(after_s + fault.seconds, answer)]
        spoiled = {
            MeterFaultKind.GARBLE_BYTE: self._garbled(answer),
            MeterFaultKind.DROP_BYTE: self._dropped(answer),
            MeterFaultKind.PARTIAL: answer[: len(answer) // 2],
            MeterFaultKind.JOINED: answer[:-2] + answer,
            MeterFaultKind.NULS: b"\0\0\0" + answer,
            MeterFaultKind.ECHO: b"MES\r\n" + answer,
            MeterFaultKind.FLOOD: b"U" * 10_240,
            MeterFaultKind.OVER_RANGE: b"ER10\r\n",
            MeterFaultKind.ERROR_CODE: b"ER20\r\n",
            MeterFaultKind.BATTERY_LOW: b"ER30\r\n",
            MeterFaultKind.UNIT_FL: answer.replace(b"Cc", b"Cf").replace(b"OK00,0,", b"OK00,1,"),
            MeterFaultKind.PER_CENT: answer.replace(b"CcPH", b"C% H"),
            MeterFaultKind.PEAK: answer.replace(b"CcPH", b"PcPH"),
            MeterFaultKind.FROZEN: answer,
        }[kind]
        return [Piece(after_s, spoiled)]

    def _garbled(self, answer: bytes) -> bytes:
        """Flip one bit of one character, as noise does; the parity of a real line would show it: it becomes NUL."""
        place = self._random.randrange(len(answer) - 2)
        return answer[:place] + b"\0" + answer[place + 1 :]

    def _dropped(self, answer: bytes) -> bytes:
        place = self._random.randrange(len(answer) - 2)
        return answer[:place] + answer[place + 1 :]


LINE_END = b"\r\n"
MAX_QUESTION_BYTES = 256


class Instrument(Protocol):
    """Anything that answers lines, as `mocks.instruments.ls160.SimulatedMeter` does."""

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        """Return the timed answer to one question."""
        ...


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
        """Pull the plug and put it in again: the port has another number then."""
        before, self._plug = self._plug, _Plug(self._answer)
        if self._plug.name == self.name:  # the system gives a free number again: keep this one busy meanwhile
            taken, self._plug = self._plug, _Plug(self._answer)
            taken.pull()
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

    def _answer(self, line: bytes, plug: _Plug) -> None:
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

    def __init__(self, answer: Callable[[bytes, _Plug], None]) -> None:
        self._answer = answer
        self._master, self._slave = os.openpty()
        # Raw: bytes pass as on a wire. The slave stays open here, so that the master lives while nobody listens.
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
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
            while LINE_END in heard and not self.pulled.is_set():
                line, _, rest = bytes(heard).partition(LINE_END)
                heard = bytearray(rest)
                self._answer(line, self)
            del heard[:-MAX_QUESTION_BYTES]
        for fd in (self._master, self._slave, self._wake_read, self._wake_write):
            with suppress(OSError):
                os.close(fd)
