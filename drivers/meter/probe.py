"""Find out what an unknown meter speaks: the questions of all known siblings, and a transcript to make a dialect of.

Every byte goes into the transcript by way of the line (`drivers.transcript.RecordedLine`). Nothing is stored, erased or
calibrated on the meter; it is asked who it is and to measure, and left in local mode.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.meter.dialect import Dialect
from drivers.meter.dialogue import interpret
from drivers.meter.ls160 import KonicaMinoltaMeter
from drivers.serial_link import ByteLine, PortSettings

LINE_ENDS = (b"\r\n", b"\r", b"\n")
SETTINGS = (
    PortSettings(38400),
    PortSettings(38400, 7, "even", 2),
    PortSettings(9600, 7, "even", 1),
    PortSettings(9600),
    PortSettings(115200),
    PortSettings(4800, 7, "even", 2, rts_handshake=True),
)
"""Of the CS-200 (over USB any will do), CA-410, CL-200, CS-2000 and LS-100."""
OPENINGS = ("RMT,1", "RMTS,1", "COM,1", "IDR", "MDS,04")
"""Remote mode of the CS-200, CS-2000 and CA-410, identity of the CS-200, absolute mode of the LS-100."""
IDENTITY = ("IDDR", "IDQ", "STR")
MEASURING = ("MES,1", "MDR,0", "MEAS,1", "MEDR,0,0,1", "MEDR,2,0,02", "MES")
LEAVING = ("RMT,0", "RMTS,0", "COM,0")
# Bounds: chosen, far above what a meter of this family needs (an answer takes 0.1 s, AUTO measures for 4.3 s at most).
ANSWER_LIMIT_S = 1.0
MEASURING_LIMIT_S = 6.0  # chosen
AFTER_S = 0.3  # how long a further line of one answer is waited for
QUIET_S = 0.05  # chosen: see `drivers.meter.dialogue`
MAX_LINE_BYTES, MAX_ANSWER_BYTES = 256, 1024  # chosen
READING_LIMIT_S = 20.0  # chosen: the rig file's usual limit


@dataclass(frozen=True)
class Exchange:
    """One question of a probe and all that came back. ``note``: why there is none."""

    settings: PortSettings
    line_end: bytes
    sent: str
    received: bytes
    note: str = ""

    def __str__(self) -> str:
        """A line for a person: what is no printable ASCII is a dot."""
        question, said = (
            "".join(chr(b) if 32 <= b < 127 else "." for b in data)
            for data in (self.sent.encode() + self.line_end, self.received)
        )
        return f"{self.settings.baud:>6} {question:<14} {said or self.note}"


@dataclass(frozen=True)
class Trial:
    """A dialect whose greeting was answered, and the reading it gave (None: the status or error is in ``detail``)."""

    dialect: Dialect
    luminance_cd_m2: float | None
    detail: str = ""


def probe(open_line: Callable[[PortSettings], ByteLine], clock: Clock) -> Iterator[Exchange]:
    """Ask at all port settings and line ends; yields every exchange as it happens.

    Where nothing answers an opening question the others are left out; those that measure are asked once a line end.
    """
    measured: set[bytes] = set()
    for settings in SETTINGS:
        try:
            line = open_line(settings)
        except DeviceError as error:
            yield Exchange(settings, b"", "", b"", note=str(error))
            continue
        try:
            for line_end in LINE_ENDS:
                yield from _ask_all(_Asker(line, settings, line_end, clock), measured)
        except DeviceError as error:
            yield Exchange(settings, b"", "", b"", note=str(error))
        finally:
            line.close()


def _ask_all(asker: "_Asker", measured: set[bytes]) -> Iterator[Exchange]:
    asker.ask("")  # ends what another line end left unfinished in the meter
    answered = False
    for question in OPENINGS:
        exchange = asker.ask(question)
        answered |= bool(exchange.received)
        yield exchange
    if answered:
        more = MEASURING if asker.line_end not in measured else ()
        measured.add(asker.line_end)
        for question in (*IDENTITY, *more, *LEAVING):
            yield asker.ask(question)


@dataclass(frozen=True)
class _Asker:
    """Asks over one open line, with one line end."""

    line: ByteLine
    settings: PortSettings
    line_end: bytes
    clock: Clock

    def ask(self, question: str) -> Exchange:
        """Ask, and take down all that comes until the line falls silent."""
        unasked = self.line.drain(QUIET_S, 0.5)
        self.line.write(question.encode() + self.line_end, 2.0)
        measures = question in MEASURING
        limit_s = MEASURING_LIMIT_S if measures else ANSWER_LIMIT_S if question else AFTER_S
        received, note = b"", f"{unasked} bytes before" if unasked else ""
        while len(received) < MAX_ANSWER_BYTES:
            try:
                received += self.line.read_line(self.line_end[-1:], MAX_LINE_BYTES, limit_s) + self.line_end[-1:]
            except DeviceTimeoutError as error:
                received += bytes.fromhex(str(error.details.get("partial", "")))
                break
            waits = measures and received.startswith(b"OK00,") and received.count(b",") == 1  # announces its seconds
            limit_s = MEASURING_LIMIT_S if waits else AFTER_S
        return Exchange(self.settings, self.line_end, question, received, note)


def greeted(dialect: Dialect, exchanges: Sequence[Exchange]) -> bool:
    """Whether a line that came back to the dialect's greeting has the dialect's form."""
    step, line_end = dialect.connect[0], dialect.line_end.encode()
    answers = [e.received for e in exchanges if e.sent == step.send and e.line_end == line_end]
    return any(interpret(dialect, step, raw).ok for answer in answers for raw in answer.split(line_end)[:-1])


def try_dialects(
    open_line: Callable[[PortSettings], ByteLine], dialects: Sequence[Dialect], heard: Sequence[Exchange], clock: Clock
) -> Iterator[Trial]:
    """Take one reading in every dialect whose greeting was answered as it should be."""
    for dialect in dialects:
        if not greeted(dialect, heard):
            continue
        settings = dialect.port
        meter = KonicaMinoltaMeter(lambda settings=settings: open_line(settings), dialect, clock)  # type: ignore[misc]
        try:
            meter.connect()
            reading = meter.measure(timeout_s=READING_LIMIT_S)
            yield Trial(dialect, reading.luminance_cd_m2, f"{reading.status} {reading.detail}".strip())
        except DeviceError as error:
            yield Trial(dialect, None, error.message)
        finally:
            meter.close()
