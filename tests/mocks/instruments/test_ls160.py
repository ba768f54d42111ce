"""The simulated meter against its manuals: it must be a fair opponent."""

from __future__ import annotations

import pytest

from mocks.instruments.ls160 import MeterFault, MeterFaultKind, SimulatedMeter
from mocks.instruments.serial_port import Piece
from tests.drivers.memory_line import MemoryLine
from tests.virtual_clock import VirtualClock


def said(pieces: list[Piece]) -> bytes:
    return b"".join(p.data or b"" for p in pieces)


def meter(luminance: float = 125.35, language: str = "ls100", **how: object) -> SimulatedMeter:
    return SimulatedMeter(lambda _t: luminance, language=language, noise_frac=0, **how)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (b"MES", b"OK00,CcPH 125.3\r\n"),
        (b"MDS,00", b"OK00\r\n"),
        (b"MDS,04", b"OK00\r\n"),
        (b"MDS,09", b"OK00\r\n"),
        (b"MDS,10", b"ER00\r\n"),
        (b"CLE", b"OK00\r\n"),
        (b"mes", b"ER00\r\n"),
        (b"MES ", b"ER00\r\n"),
        (b"", b"ER00\r\n"),
        (b"\xff", b"ER00\r\n"),
        (b"DSR", b"ER00\r\n"),
    ],
)
def test_ls100_questions(question: bytes, answer: bytes) -> None:
    assert said(meter(125.349).hear(question, 0.0)) == answer


def test_dsr_gives_the_held_value_again() -> None:
    instrument = SimulatedMeter(lambda t: 100 + t, noise_frac=0)
    first = instrument.hear(b"MES", 0.0)
    assert said(instrument.hear(b"DSR", 10.0)) == said(first)
    assert said(instrument.hear(b"MES", 20.0)) == b"OK00,CcPH 120.0\r\n"


def test_it_is_deaf_while_it_measures() -> None:
    instrument = meter(measuring_s=0.4)
    assert instrument.hear(b"MES", 0.0)[0].after_s == 0.4
    assert instrument.hear(b"MES", 0.39) == []
    assert instrument.hear(b"MDS,04", 0.41)


def test_nothing_overtakes_on_one_wire() -> None:
    instrument = meter(faults=(MeterFault(MeterFaultKind.LAGGING, last=1, seconds=5.0),))
    late = instrument.hear(b"MES", 0.0)[0]
    then = instrument.hear(b"MDS,04", 1.0)[0]
    assert 1.0 + then.after_s >= late.after_s == 5.4


@pytest.mark.parametrize(
    ("luminance", "shown"),
    [(0.0, "0.00"), (0.054, "0.05"), (3.14159, "3.14"), (34.634, "34.63"), (125.349, "125.3"), (74812.0, "74810")],
)
def test_four_digits_on_the_display(luminance: float, shown: str) -> None:
    instrument = meter(luminance)
    assert said(instrument.hear(b"MES", 0.0)) == f"OK00,CcPH{shown:>6}\r\n".encode()
    assert instrument.shown == [shown]


@pytest.mark.parametrize(("language", "top"), [("ls100", 299_900.0), ("cs100a", 299_000.0)])
def test_over_its_range_it_says_so(language: str, top: float) -> None:
    assert said(meter(top * 1.1, language).hear(b"MES", 0.0)) == b"ER10\r\n"
    assert said(meter(top * 0.9, language).hear(b"MES", 0.0)).startswith(b"OK00,")


def test_ls160_measures_in_remote_mode_in_two_steps() -> None:
    instrument = meter(language="ls160", measuring_s=1.5)
    assert said(instrument.hear(b"MES,1", 0.0)) == b"ER16\r\n", "not in remote mode"
    assert said(instrument.hear(b"RMT,1", 0.0)) == b"OK00\r\n"
    assert said(instrument.hear(b"MDR,0", 0.5)) == b"ER20\r\n", "no data yet"
    assert said(instrument.hear(b"MES,1", 1.0)) == b"OK00,02\r\n"
    assert said(instrument.hear(b"MDR,0", 2.0)) == said(instrument.hear(b"RMT,1", 2.1)) == b"ER02\r\n", "measuring"
    line = said(instrument.hear(b"MDR,0", 3.1))
    assert (len(line), line[27:38], line[39:50], line[51:62]) == (64, b"      125.3", b"     0.3127", b"     0.3290")
    assert said(instrument.hear(b"MDR,0", 9.0)) == line
    assert said(instrument.hear(b"RMT,0", 10.0)) == b"OK00\r\n"
    assert said(instrument.hear(b"MDR,0", 11.0)) == b"ER16\r\n"


def test_cs2000_says_twice_that_it_heard_and_that_it_is_done() -> None:
    instrument = meter(language="cs2000", measuring_s=1.5)
    assert said(instrument.hear(b"RMTS,1\r", 0.0)) == b"OK00\n"
    assert [(round(p.after_s, 2), p.data) for p in instrument.hear(b"MEAS,1", 1.0)] == [
        (0.02, b"OK00,02\n"),
        (1.5, b"OK00\n"),
    ]
    assert said(instrument.hear(b"MEDR,2,0,02", 2.6)) == b"OK00,1.2530e+02,3.1270e-01,3.2900e-01\n"


def test_ca410_answers_at_once() -> None:
    instrument = meter(language="ca410", measuring_s=0.4)
    assert said(instrument.hear(b"\nCOM,1", 0.0)) == b"OK00\r"
    assert said(instrument.hear(b"MES,1", 1.0)) == b"OK00,P1,0,0.3127000,0.3290000,125.3,-0.01,-99999999\r"
    assert said(instrument.hear(b"MES", 2.0)) == b"ER10\r"


GOOD = b"OK00,CcPH 125.3\r\n"


@pytest.mark.parametrize(
    ("kind", "answer"),
    [
        (MeterFaultKind.OVER_RANGE, b"ER10\r\n"),
        (MeterFaultKind.ERROR_CODE, b"ER20\r\n"),
        (MeterFaultKind.BATTERY_LOW, b"ER30\r\n"),
        (MeterFaultKind.UNIT_FL, b"OK00,CfPH 125.3\r\n"),
        (MeterFaultKind.PER_CENT, b"OK00,C% H 125.3\r\n"),
        (MeterFaultKind.PEAK, b"OK00,PcPH 125.3\r\n"),
        (MeterFaultKind.JOINED, b"OK00,CcPH 125.3OK00,CcPH 125.3\r\n"),
        (MeterFaultKind.NULS, b"\0\0\0" + GOOD),
        (MeterFaultKind.ECHO, b"MES\r\n" + GOOD),
        (MeterFaultKind.PARTIAL, b"OK00,CcP"),
        (MeterFaultKind.FLOOD, b"U" * 10_240),
        (MeterFaultKind.NO_ANSWER, b""),
    ],
)
def test_each_fault_is_what_it_says_and_only_where_it_says(kind: MeterFaultKind, answer: bytes) -> None:
    instrument = meter(125.349, faults=(MeterFault(kind, first=2, last=2),))
    assert said(instrument.hear(b"MES", 0.0)) == GOOD
    assert said(instrument.hear(b"MES", 1.0)) == answer
    assert said(instrument.hear(b"MES", 30.0)) == GOOD


@pytest.mark.parametrize("kind", [MeterFaultKind.GARBLE_BYTE, MeterFaultKind.DROP_BYTE])
def test_noise_changes_one_byte(kind: MeterFaultKind) -> None:
    answer = said(meter(125.349, faults=(MeterFault(kind),)).hear(b"MES", 0.0))
    assert answer != GOOD
    assert abs(len(answer) - len(GOOD)) <= 1


def test_frozen_repeats_the_last_number() -> None:
    instrument = SimulatedMeter(
        lambda t: 100 + t, noise_frac=0, faults=(MeterFault(MeterFaultKind.FROZEN, first=2, last=3),)
    )
    assert [said(instrument.hear(b"MES", 10.0 * n))[-8:-2] for n in range(4)] == [b" 100.0"] * 3 + [b" 130.0"]


def test_unplug_is_no_bytes_at_all() -> None:
    assert meter(faults=(MeterFault(MeterFaultKind.UNPLUG),)).hear(b"MES", 0.0)[0].data is None


def test_the_same_seed_gives_the_same_noise() -> None:
    def run(seed: int) -> list[str]:
        instrument = SimulatedMeter(lambda _t: 125.35, seed=seed)
        for n in range(5):
            instrument.hear(b"MES", float(n))
        return instrument.shown

    assert run(1) == run(1) != run(2)


def test_a_line_in_memory_keeps_time() -> None:
    clock = VirtualClock()
    line = MemoryLine(meter(measuring_s=0.4), clock)
    line.write(b"MES\r\n", 1.0)
    assert line.read_line(b"\r\n", 64, 1.0) == b"OK00,CcPH 125.3"
    assert clock.monotonic_s() == pytest.approx(0.4)
