"""The simulated luminance meter: what it hears, what it says, and how it may misbehave.

Written from the instruments' manuals, not from the dialect files that it is to test. A meter takes bytes and gives
back timed pieces of bytes, so that the same instrument serves a pseudo-terminal and a line in memory.
"""

import math
import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from mocks.instruments.serial_port import Piece
from processing.ground.tables import table_of


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


@dataclass(frozen=True)
class Language:
    """What one model hears and says. A meter in two steps (``on`` is its remote mode) measures in the background."""

    reading: str
    """Format of an answer: {0} is the number as text, {1} as a number."""
    top_cd_m2: float
    """Above this a meter says that it is out of range (data sheets, from memory)."""
    measure: str = "MES"
    over: str = "ER10"
    error: str = "ER20"
    battery: str = "ER30"
    unknown: str = "ER00"
    agrees: str = "MDS,0?[0-9]|CLE"
    """Questions that are answered with OK00."""
    says: Mapping[str, str] = field(default_factory=dict)
    """Fixed answers."""
    again: str = ""
    on: str = ""
    off: str = ""
    not_remote: str = "ER00"
    done: bool = False
    """Whether a second OK00 says that the measurement is over."""
    line_end: str = "\r\n"


LANGUAGES = {name: Language(**facts) for name, facts in table_of(__package__, "ls160").items()}


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


class SimulatedMeter:
    """A meter that looks at a luminance.

    ``luminance_cd_m2``: what it looks at, as a function of seconds since it was made.
    ``language``: a key of `LANGUAGES`.
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
        self._words = LANGUAGES[language]
        self.line_end = self._words.line_end.encode()
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
        said = self._two_steps if self._words.on else self._one_step
        pieces = said(line.decode("ascii", "replace").strip("\0\r\n"), now_s)
        ready_s = self._sent_until_s - now_s  # one wire: nothing overtakes
        pieces = [Piece(max(p.after_s, ready_s), p.data) for p in pieces]
        if pieces:
            self._sent_until_s = now_s + pieces[-1].after_s
        return pieces

    def _line(self, text: str) -> bytes:
        return text.encode() + self.line_end

    def _one_step(self, text: str, now_s: float) -> list[Piece]:
        words = self._words
        if text == words.measure:
            return self._measured(now_s)
        if words.again and text == words.again:
            return [Piece(0.05, self._held or self._line(words.unknown))]
        agreed = "OK00" if re.fullmatch(words.agrees, text) else words.unknown
        return [Piece(0.05, self._line(words.says.get(text, agreed)))]

    def _two_steps(self, text: str, now_s: float) -> list[Piece]:
        words = self._words
        if now_s < self._measured_at_s:
            said = "ER02"
        elif text in (words.on, words.off):
            self._remote, said = text == words.on, "OK00"
        elif text in words.says:
            said = words.says[text]
        elif text not in (words.measure, words.again):
            said = words.unknown
        elif not self._remote:
            said = words.not_remote
        elif text == words.measure:
            return self._begin(now_s)
        elif self.n_measured:
            return [Piece(0.02 + self._lag_s, self._held)] if self._held else []
        else:
            said = "ER20"
        return [Piece(0.02, self._line(said))]

    def _begin(self, now_s: float) -> list[Piece]:
        """Measure in the background: the answer says how long that takes; the data stay until the next time."""
        pieces, late_s = self._measured(now_s), max(0.0, self._busy_until_s - now_s - self.measuring_s)
        self._busy_until_s = float("-inf")
        if pieces and pieces[-1].data is None:
            return pieces
        self._held = pieces[-1].data if pieces else None
        self._lag_s = pieces[-1].after_s - self.measuring_s - late_s if pieces else 0.0
        self._measured_at_s = now_s + self.measuring_s + late_s
        announced = Piece(0.02, self._line(f"OK00,{math.ceil(self.measuring_s):02d}"))
        return [announced, Piece(self._measured_at_s - now_s, self._line("OK00"))] if self._words.done else [announced]

    def _measured(self, now_s: float) -> list[Piece]:
        self.n_measured += 1
        fault = next((f for f in self._faults if f.hits(self.n_measured)), None)
        number = self._number(now_s)
        if fault is not None and fault.kind is MeterFaultKind.FROZEN and self._last_number:
            number = self._last_number
        self._last_number = number
        self.shown.append(number)
        say = self._words
        answer = self._line(say.over if float(number) > say.top_cd_m2 else say.reading.format(number, float(number)))
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
        return f"{value:.{decimals}f}" if decimals else f"{float(f'{value:.4g}'):.0f}"

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
            MeterFaultKind.GARBLE_BYTE: self._damaged(answer, b"\0"),
            MeterFaultKind.DROP_BYTE: self._damaged(answer, b""),
            MeterFaultKind.PARTIAL: answer[: len(answer) // 2],
            MeterFaultKind.JOINED: answer.removesuffix(self.line_end) + answer,
            MeterFaultKind.NULS: b"\0\0\0" + answer,
            MeterFaultKind.ECHO: self._line(self._words.measure) + answer,
            MeterFaultKind.FLOOD: b"U" * 10_240,
            MeterFaultKind.OVER_RANGE: self._line(self._words.over),
            MeterFaultKind.ERROR_CODE: self._line(self._words.error),
            MeterFaultKind.BATTERY_LOW: self._line(self._words.battery),
            MeterFaultKind.UNIT_FL: answer.replace(b"Cc", b"Cf"),
            MeterFaultKind.PER_CENT: answer.replace(b"CcPH", b"C% H"),
            MeterFaultKind.PEAK: answer.replace(b"CcPH", b"PcPH"),
            MeterFaultKind.FROZEN: answer,
        }[kind]
        return [Piece(after_s, spoiled)]

    def _damaged(self, answer: bytes, instead: bytes) -> bytes:
        """Replace one character by chance: a flipped bit fails the parity of a real line and becomes NUL."""
        place = self._random.randrange(len(answer) - 2)
        return answer[:place] + instead + answer[place + 1 :]
