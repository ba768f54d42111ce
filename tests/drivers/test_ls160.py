"""The meter driver: byte-exact dialogues, and a status for everything that is no plain luminance."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import SystemClock
from drivers.errors import (
    BatteryLowError,
    DeviceClaimedError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceTimeoutError,
    ProtocolViolationError,
)
from drivers.meter.dialect import SHIPPED, load_dialect
from drivers.meter.dialogue import interpret
from drivers.meter.interface import Meter, MeterReading, ReadingStatus
from drivers.meter.ls160 import FROZEN_EQUALS, KonicaMinoltaMeter
from drivers.serial_link import SerialLink
from mocks.instruments.ls160 import MeterFault, MeterFaultKind, SimulatedMeter
from mocks.instruments.serial_port import SerialPort
from tests.drivers.memory_line import MemoryLine
from tests.virtual_clock import VirtualClock

LS100 = load_dialect("ls100")


class ScriptedLine:
    """Answers exactly the questions expected, in order."""

    name = "script"

    def __init__(self, *dialogue: tuple[bytes, bytes | None]) -> None:
        self.dialogue = list(dialogue)
        self._answer: bytes | None = None

    def write(self, data: bytes, timeout_s: float) -> None:
        expected, self._answer = self.dialogue.pop(0)
        assert data == expected

    def read_line(self, delimiter: bytes, max_bytes: int, timeout_s: float) -> bytes:
        if self._answer is None:
            raise DeviceTimeoutError("silence", partial="")
        line, mark, rest = self._answer.partition(delimiter)
        if not mark:
            raise DeviceTimeoutError("half a line", partial=line.hex())
        self._answer = rest or None
        return line

    def drain(self, quiet_s: float, limit_s: float) -> int:
        self._answer = None
        return 0

    def close(self) -> None:
        return None


def speak(*dialogue: tuple[bytes, bytes | None], dialect: str = "ls100") -> tuple[KonicaMinoltaMeter, ScriptedLine]:
    line = ScriptedLine(*dialogue)
    return KonicaMinoltaMeter(lambda: line, load_dialect(dialect), VirtualClock()), line


def simulated(
    *faults: MeterFault, language: str = "ls100", luminance: float = 34.63, noise: float = 1e-3
) -> KonicaMinoltaMeter:
    clock = VirtualClock()
    instrument = SimulatedMeter(lambda _t: luminance, language=language, faults=faults, noise_frac=noise)
    return KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), load_dialect(language), clock)


GREETING = ((b"MDS,04\r\n", b"OK00\r\n"), (b"MDS,09\r\n", b"OK00,CcPH 34.63\r\n"))


def test_ls100_dialogue_is_the_manuals() -> None:
    answer = b"OK00,CcPH 34.63\r\n"
    meter, line = speak(*GREETING, (b"MES\r\n", answer), (b"DSR\r\n", answer))
    identity = meter.connect()
    reading = meter.measure()
    meter.close()
    assert reading.luminance_cd_m2 == 34.63
    assert identity.dialect_verified
    assert not line.dialogue, "nothing left unsaid"


# As public programs for the CS-200 have it: seconds in two columns; Lv in characters 27 to 37, x from 39, y from 51.
CS200 = b"OK00,0,0,0,01,0,0,00,00000,    1019.00,     0.3127,     0.3290"
CS2000 = b"OK00,1.0190e+03,3.1270e-01,3.2900e-01"
CA410 = b"OK00,P1,0,0.3362781,0.3559744,12.563168,-0.01,-99999999"
DIALOGUES = {
    "ls160": (
        (b"RMT,1\r\n", b"OK00\r\n"),
        (b"MES,1\r\n", b"OK00,02\r\n"),
        (b"MDR,0\r\n", b"ER02\r\n"),
        (b"MDR,0\r\n", b"ER02\r\n"),
        (b"MDR,0\r\n", CS200 + b"\r\n"),
        (b"MDR,0\r\n", CS200 + b"\r\n"),
        (b"RMT,0\r\n", b"OK00\r\n"),
    ),
    "cs2000": (
        (b"RMTS,1\n", b"OK00\n"),
        (b"MEAS,1\n", b"OK00,4\nOK00\n"),
        (b"MEDR,2,0,02\n", CS2000 + b"\r\n"),
        (b"MEDR,2,0,02\n", CS2000 + b"\r\n"),
        (b"RMTS,0\n", b"OK00\n"),
    ),
    "ca410": (
        (b"COM,1\r", b"OK00\r"),
        (b"MDS,0\r", b"\nOK00\r"),
        (b"LUS,1\r", b"OK00\r"),
        (b"MES,1\r", CA410 + b"\r"),
        (b"COM,0\r", b"OK00\r"),
    ),
}


@pytest.mark.parametrize(("dialect", "shown"), [("ls160", 1019.0), ("cs2000", 1019.0), ("ca410", 12.563168)])
def test_the_dialogue_of_each_candidate_is_its_siblings_and_says_that_it_is_assumed(dialect: str, shown: float) -> None:
    meter, line = speak(*DIALOGUES[dialect], dialect=dialect)
    assert not meter.connect().dialect_verified
    reading = meter.measure()
    meter.close()
    assert reading.luminance_cd_m2 == shown
    assert not reading.dialect_verified
    assert not line.dialogue, "nothing left unsaid"


@pytest.mark.parametrize(
    ("dialect", "answer", "status"),
    [
        ("ls160", CS200, ReadingStatus.OK),
        ("ls160", CS200.replace(b"OK00", b"OK03"), ReadingStatus.OK),  # the battery is weak, the value stands
        ("ls160", CS200.replace(b"    1019.00", b" 1.0190E+03"), ReadingStatus.OK),
        ("ls160", CS200.replace(b"OK00", b"OK12"), ReadingStatus.OVER_RANGE),
        ("ls160", CS200.replace(b"    1019.00", b"   1019.00"), ReadingStatus.GARBLED),  # a column is lost
        ("ls160", CS200.replace(b"    1019.00", b"    10-9.00"), ReadingStatus.GARBLED),
        ("ls160", CS200 + CS200, ReadingStatus.GARBLED),
        ("ls160", CS200[:50], ReadingStatus.GARBLED),
        ("ls160", b"OK00,0,  1019.00", ReadingStatus.GARBLED),  # what this dialect was before
        ("ls160", b"ER01", ReadingStatus.BATTERY_LOW),
        ("ls160", b"ER02", ReadingStatus.ERROR_CODE),
        ("ls160", b"ER21", ReadingStatus.UNDER_RANGE),
        ("ls160", b"ER22", ReadingStatus.OVER_RANGE),
        ("ls160", b"ER27", ReadingStatus.ERROR_CODE),
        ("cs2000", CS2000, ReadingStatus.OK),
        ("cs2000", b"OK00", ReadingStatus.GARBLED),
        ("cs2000", CS2000[:-8], ReadingStatus.GARBLED),
        ("cs2000", b"ER10", ReadingStatus.OVER_RANGE),
        ("cs2000", b"ER51", ReadingStatus.ERROR_CODE),
        ("ca410", CA410, ReadingStatus.OK),
        ("ca410", b"OK04,P1,0,-99999999,-99999999,-99999999,-0.02,0.7662706", ReadingStatus.UNDER_RANGE),
        ("ca410", CA410.replace(b"12.563168", b"-99999999"), ReadingStatus.GARBLED),
        ("ca410", CA410.replace(b"0.3362781,", b""), ReadingStatus.GARBLED),
        ("ca410", b"ER10", ReadingStatus.ERROR_CODE),
    ],
)
def test_what_a_line_of_a_candidate_means(dialect: str, answer: bytes, status: ReadingStatus) -> None:
    spoken = load_dialect(dialect)
    assert interpret(spoken, spoken.measure[-1], answer).status is status


def test_a_meter_that_measures_for_ever_is_given_up() -> None:
    clock = VirtualClock()
    instrument = SimulatedMeter(
        lambda _t: 10.0, language="ls160", faults=(MeterFault(MeterFaultKind.LATE, seconds=1e6),)
    )
    meter = KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), load_dialect("ls160"), clock)
    meter.connect()
    reading = meter.measure(timeout_s=300.0)
    assert (reading.status, reading.raw) == (ReadingStatus.ERROR_CODE, "ER02")
    assert "still measuring" in reading.detail
    assert clock.monotonic_s() < load_dialect("ls160").busy_limit_s + 10


@pytest.mark.parametrize(
    ("answer", "status"),
    [
        (b"OK00,CcPH125.35", ReadingStatus.OK),
        (b"OK00,CcPH  0.35", ReadingStatus.OK),
        (b"OK00,CfPH125.35", ReadingStatus.WRONG_UNIT),
        (b"OK00,P% H 83.02", ReadingStatus.WRONG_MODE),
        (b"OK00,C% H 83.02", ReadingStatus.WRONG_UNIT),
        (b"OK00,PcPH 83.02", ReadingStatus.WRONG_MODE),
        (b"OK00,CcLH 83.02", ReadingStatus.WRONG_MODE),
        (b"ER10", ReadingStatus.OVER_RANGE),
        (b"ER19", ReadingStatus.OVER_RANGE),
        (b"ER30", ReadingStatus.BATTERY_LOW),
        (b"ER20", ReadingStatus.ERROR_CODE),
        (b"ER00", ReadingStatus.ERROR_CODE),
        (b"OK00,CcPH12 .35", ReadingStatus.GARBLED),
        (b"OK00,CcPH 34.6", ReadingStatus.GARBLED),
        (b"OK00,CcPH 34.63 ", ReadingStatus.GARBLED),
        (b"OK00,CcPH 34,63", ReadingStatus.GARBLED),
        (b"OK00,CcPH 3.4.6", ReadingStatus.GARBLED),
        (b"MESOK00,CcPH 34.63", ReadingStatus.GARBLED),
        (b"OK00,CcPH 34.63OK00,CcPH 34.63", ReadingStatus.GARBLED),
        (b"\0OK00,CcPH 34.63", ReadingStatus.GARBLED),
        (b"OK00,CcPH -4.63", ReadingStatus.GARBLED),
        (b"OK00,CcPH   nan", ReadingStatus.GARBLED),
        (b"OK00,CcPH 1e-03", ReadingStatus.GARBLED),
        (b"", ReadingStatus.GARBLED),
        (b"\xff\xfe", ReadingStatus.GARBLED),
    ],
)
def test_what_a_line_means(answer: bytes, status: ReadingStatus) -> None:
    assert interpret(LS100, LS100.measure[0], answer).status is status


@given(st.binary(max_size=60), st.sampled_from(SHIPPED))
def test_any_bytes_are_interpreted_without_error(line: bytes, name: str) -> None:
    dialect = load_dialect(name)
    answer = interpret(dialect, dialect.measure[-1], line)
    assert answer.status is not ReadingStatus.OK or line.startswith(b"OK")


SPOILED = {
    MeterFaultKind.OVER_RANGE: ReadingStatus.OVER_RANGE,
    MeterFaultKind.ERROR_CODE: ReadingStatus.ERROR_CODE,
    MeterFaultKind.BATTERY_LOW: ReadingStatus.BATTERY_LOW,
    MeterFaultKind.UNIT_FL: ReadingStatus.WRONG_UNIT,
    MeterFaultKind.PER_CENT: ReadingStatus.WRONG_UNIT,
    MeterFaultKind.PEAK: ReadingStatus.WRONG_MODE,
    MeterFaultKind.NO_ANSWER: ReadingStatus.NO_ANSWER,
    MeterFaultKind.PARTIAL: ReadingStatus.GARBLED,
    MeterFaultKind.FLOOD: ReadingStatus.GARBLED,
    MeterFaultKind.JOINED: ReadingStatus.GARBLED,
    MeterFaultKind.NULS: ReadingStatus.GARBLED,
    MeterFaultKind.GARBLE_BYTE: ReadingStatus.GARBLED,
    MeterFaultKind.DROP_BYTE: ReadingStatus.GARBLED,
    MeterFaultKind.LATE: ReadingStatus.NO_ANSWER,
    MeterFaultKind.LAGGING: ReadingStatus.NO_ANSWER,
}


def measure(meter: KonicaMinoltaMeter, **how: float) -> MeterReading:
    meter.connect()
    return meter.measure(**how)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", SPOILED)
def test_a_lasting_fault_is_a_status_and_no_number(kind: MeterFaultKind) -> None:
    reading = measure(simulated(MeterFault(kind, seconds=30.0)))
    assert reading.status is SPOILED[kind]
    assert reading.luminance_cd_m2 is None


@pytest.mark.parametrize(
    "kind", [k for k, s in SPOILED.items() if s in (ReadingStatus.GARBLED, ReadingStatus.NO_ANSWER)]
)
def test_a_passing_fault_is_asked_again(kind: MeterFaultKind) -> None:
    reading = measure(simulated(MeterFault(kind, last=1, seconds=9.0)), timeout_s=40.0)
    assert reading.luminance_cd_m2 == pytest.approx(34.63, rel=0.01)


@pytest.mark.parametrize("kind", [MeterFaultKind.LATE, MeterFaultKind.LAGGING])
@pytest.mark.parametrize("language", SHIPPED)
@pytest.mark.parametrize("seconds", [0.5, 2.7, 5.1, 7.6, 7.8, 8.3, 9.6, 11.0, 14.0, 19.5])
def test_an_answer_belongs_to_its_own_question(kind: MeterFaultKind, language: str, seconds: float) -> None:
    """Each measurement shows another number: the one returned must be of the last question put."""
    clock = VirtualClock()
    numbers = itertools.count(11)
    instrument = SimulatedMeter(
        lambda _t: next(numbers), language=language, noise_frac=0, faults=(MeterFault(kind, last=1, seconds=seconds),)
    )
    meter = KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), load_dialect(language), clock)
    meter.connect()
    for _ in range(3):
        reading = meter.measure(timeout_s=60.0)
        assert reading.luminance_cd_m2 in (None, float(instrument.shown[-1]))
    assert reading.status is ReadingStatus.OK, "in the end it is in step again"


def test_a_doubled_answer_is_not_the_next_ones() -> None:
    """An old answer that comes just after the line was looked at: the second transmission does not agree."""
    new = b"OK00,CcPH 50.00\r\n"
    meter, line = speak(
        *GREETING,
        (b"MES\r\n", b"OK00,CcPH 34.63\r\n"),  # of an earlier question
        (b"DSR\r\n", new),  # what MES was answered with
        (b"MDS,04\r\n", b"OK00\r\n"),
        (b"MES\r\n", new),
        (b"DSR\r\n", new),
    )
    meter.connect()
    assert meter.measure().luminance_cd_m2 == 50.0
    assert not line.dialogue


def test_greeting_that_could_be_a_late_reading_is_waited_out() -> None:
    """MDS may be answered with a value (the manual contradicts itself): silence must follow before that counts."""
    meter, line = speak(
        (b"MDS,04\r\n", b"OK00,CcPH 34.63\r\nOK00\r\n"),
        (b"MDS,09\r\n", b"OK00\r\n"),
    )
    meter.connect()
    meter, line = speak((b"MDS,04\r\n", b"OK00,CcPH 34.63\r\n"), (b"MDS,09\r\n", b"OK00\r\n"))
    meter.connect()
    assert not line.dialogue


def test_an_echo_is_skipped() -> None:
    answer = b"OK00,CcPH 34.63\r\n"
    meter, line = speak(
        (b"MDS,04\r\n", b"MDS,04\r\nOK00\r\n"),
        (b"MDS,09\r\n", b"MDS,09\r\nOK00\r\n"),
        (b"MES\r\n", b"MES\r\n" + answer),
        (b"DSR\r\n", b"DSR\r\n" + answer),
    )
    meter.connect()
    assert meter.measure().luminance_cd_m2 == 34.63
    assert not line.dialogue


def test_a_misheard_question_is_put_again() -> None:
    answer = b"OK00,CcPH 34.63\r\n"
    meter, line = speak(*GREETING, (b"MES\r\n", b"ER00\r\n"), (b"MES\r\n", answer), (b"DSR\r\n", answer))
    meter.connect()
    assert meter.measure().luminance_cd_m2 == 34.63
    assert not line.dialogue


def test_a_frozen_display_is_noticed() -> None:
    meter = simulated(MeterFault(MeterFaultKind.FROZEN, first=2))
    reading = measure(meter, n_samples=4, timeout_s=60.0)
    assert reading.status is ReadingStatus.FROZEN
    assert reading.n_samples >= FROZEN_EQUALS, "it is asked on until that is certain"


def test_three_equal_readings_of_a_live_meter_are_none() -> None:
    answers = [b"OK00,CcPH 34.63\r\n"] * 3 + [b"OK00,CcPH 34.64\r\n"]
    meter, line = speak(*GREETING, *[pair for a in answers for pair in ((b"MES\r\n", a), (b"DSR\r\n", a))])
    reading = measure(meter, n_samples=3)
    assert reading.status is ReadingStatus.OK
    assert reading.n_samples == 4
    assert reading.luminance_cd_m2 == pytest.approx(34.6325)
    assert not line.dialogue


def test_equal_readings_of_a_dark_wall_are_no_freeze() -> None:
    reading = measure(simulated(luminance=0.05), n_samples=FROZEN_EQUALS + 1, timeout_s=60.0)
    assert reading.luminance_cd_m2 == pytest.approx(0.05)


def test_samples_that_disagree_are_no_number() -> None:
    reading = measure(simulated(noise=0.3), n_samples=5, timeout_s=60.0)
    assert reading.status is ReadingStatus.UNSTEADY
    assert reading.spread_frac > 0.1


def test_too_little_time_is_no_number_and_no_hang() -> None:
    clock = VirtualClock()
    instrument = SimulatedMeter(lambda _t: 10.0, measuring_s=3.0)
    meter = KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), LS100, clock)
    meter.connect()
    start_s = clock.monotonic_s()
    assert meter.measure(n_samples=10, timeout_s=5.0).status is ReadingStatus.NO_ANSWER
    assert clock.monotonic_s() - start_s < 7.0


def test_a_loose_plug_is_opened_anew_and_asked_again() -> None:
    reading = measure(simulated(MeterFault(MeterFaultKind.UNPLUG, last=1)))
    assert reading.luminance_cd_m2 == pytest.approx(34.63, rel=0.01)


@pytest.mark.parametrize("away", [DeviceNotFoundError, DevicePermissionError, DeviceClaimedError, DeviceLostError])
def test_a_plug_that_is_put_back_in_time_gives_the_reading(away: type[DeviceError]) -> None:
    """Its port comes back after three seconds, and is refused until then."""
    clock, opened_s = VirtualClock(), list[float]()
    faults = (MeterFault(MeterFaultKind.UNPLUG, last=1),)
    instrument = SimulatedMeter(lambda _t: 34.63, language="ls100", faults=faults, noise_frac=1e-3)

    def open_line() -> MemoryLine:
        opened_s.append(clock.monotonic_s())
        if 1 < len(opened_s) < 8:
            raise away("not yet")
        return MemoryLine(instrument, clock)

    meter = KonicaMinoltaMeter(open_line, LS100, clock)
    meter.connect()
    assert meter.measure(timeout_s=20.0).luminance_cd_m2 == pytest.approx(34.63, rel=0.01)
    assert opened_s[-1] - opened_s[1] == pytest.approx(3.0)


def test_unplugged_for_good_is_an_error_of_the_link() -> None:
    clock = VirtualClock()
    instrument = SimulatedMeter(lambda _t: 1.0, language="ls100", faults=(MeterFault(MeterFaultKind.UNPLUG),))
    meter = KonicaMinoltaMeter(lambda: MemoryLine(instrument, clock), LS100, clock)
    meter.connect()
    start_s = clock.monotonic_s()
    with pytest.raises(DeviceLostError):
        meter.measure(timeout_s=5.0)
    assert 5.0 <= clock.monotonic_s() - start_s < 7.0


def test_silence_at_connect_says_what_to_do() -> None:
    meter, _ = speak(*[(b"MDS,04\r\n", None)] * 3)
    with pytest.raises(DeviceTimeoutError, match="--reading"):
        meter.connect()


@pytest.mark.parametrize(
    ("answer", "kind"),
    [(b"ER30\r\n", BatteryLowError), (b"ER20\r\n", ProtocolViolationError), (b"+++\r\n", ProtocolViolationError)],
)
def test_a_greeting_that_fails_otherwise_says_why(answer: bytes, kind: type[DeviceError]) -> None:
    meter, line = speak(*[(b"MDS,04\r\n", answer)] * 3)
    with pytest.raises(kind) as caught:
        meter.connect()
    assert caught.value.where == line.name
    assert caught.value.advice


def test_it_is_a_meter() -> None:
    assert isinstance(simulated(), Meter)


@pytest.mark.parametrize("language", SHIPPED)
def test_through_the_real_pyserial(language: str) -> None:
    instrument = SimulatedMeter(lambda _t: 1019.0, language=language, measuring_s=0.02, noise_frac=0)
    port = SerialPort(instrument)
    dialect = load_dialect(language)
    clock = SystemClock()
    meter = KonicaMinoltaMeter(lambda: SerialLink.open(port.name, dialect.port, clock=clock), dialect, clock)
    try:
        meter.connect()
        assert meter.measure(n_samples=2).luminance_cd_m2 == 1019.0
    finally:
        meter.close()
        port.close()


def test_unplugged_pseudo_terminal_is_lost() -> None:
    port = SerialPort(SimulatedMeter(lambda _t: 1.0, measuring_s=0.05, faults=(MeterFault(MeterFaultKind.UNPLUG),)))
    clock = SystemClock()
    meter = KonicaMinoltaMeter(lambda: SerialLink.open(port.name, LS100.port, clock=clock), LS100, clock)
    try:
        meter.connect()
        with pytest.raises(DeviceLostError):
            meter.measure()
    finally:
        meter.close()
        port.close()


def test_a_measurement_whose_meter_is_closed_by_another_thread_opens_nothing() -> None:
    clock = VirtualClock()
    opened = []

    def open_line() -> MemoryLine:
        opened.append(1)
        return MemoryLine(SimulatedMeter(look, language="ls100"), clock)

    def look(_t_s: float) -> float:
        if len(opened) == 1:
            meter.close()  # as the station does when a capture is given up
        return 34.63

    meter = KonicaMinoltaMeter(open_line, load_dialect("ls100"), clock)
    meter.connect()
    with pytest.raises(DeviceLostError, match="closed"):
        meter.measure(n_samples=3)
    assert len(opened) == 1
    assert meter.measure().luminance_cd_m2 is not None, "asked again, it is opened again"
