"""The transcript of an unknown meter: every byte that came, and nothing measured or changed for good."""

from __future__ import annotations

import pytest

from drivers.errors import DeviceClaimedError, DeviceLostError
from drivers.meter.dialect import HARMLESS, MAX_ANSWER_BYTES, SHIPPED, Exchange, load_dialect, probe, transcript_lines
from drivers.serial_link import PortSettings
from mocks.instruments.clock import VirtualClock
from mocks.instruments.ls160 import SimulatedMeter
from mocks.instruments.serial_port import Piece
from tests.drivers.memory_line import MemoryLine

DIALECTS = tuple(load_dialect(name) for name in SHIPPED)
SEVEN_E_TWO = PortSettings(4800, 7, "even", 2, rts_handshake=True)


class Unknown:
    """A meter nobody has documented: it answers in several lines, or never ends."""

    line_end = b"\r\n"

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        self.heard.append(line)
        if line == b"IDDR":
            return [Piece(0.1, b"LS-160\r\n"), Piece(0.2, b"SN 12345678\r\n"), Piece(0.3, b"V1")]
        if line == b"RMT,0":
            return [Piece(0.0, b"U\n" * 4_000)]
        return []


def run(instrument: Unknown | SimulatedMeter) -> list[Exchange]:
    clock = VirtualClock()
    return list(probe(lambda _settings: MemoryLine(instrument, clock), DIALECTS, clock))


def test_each_port_setting_is_tried_once() -> None:
    settings = [e.settings for e in run(Unknown())]
    assert list(dict.fromkeys(settings)) == [SEVEN_E_TWO, PortSettings(38400)]
    assert len(settings) == 2 * len(HARMLESS)


def test_nothing_is_asked_that_measures_or_clears() -> None:
    instrument = Unknown()
    run(instrument)
    assert not [q for q in instrument.heard if q.startswith((b"MES", b"CLE", b"CMS", b"CMW", b"LMW", b"CCW", b"MEM"))]


def test_all_lines_of_an_answer_are_taken_down_and_a_flood_is_bounded() -> None:
    by_question = {e.sent: e for e in run(Unknown())}
    answer = by_question[b"IDDR\r\n"]
    assert answer.received == b"LS-160\r\nSN 12345678\r\nV1"
    assert answer.note == "no end of line"
    assert answer.seconds == pytest.approx(0.2)
    assert len(by_question[b"RMT,0\r\n"].received) <= MAX_ANSWER_BYTES + 2
    assert by_question[b"RMT,1\r\n"].received == b""


def test_a_known_meter_is_recognised_from_its_transcript() -> None:
    lines = list(transcript_lines(iter(run(SimulatedMeter(lambda _t: 1.0, language="ls100"))), "/dev/ttyUSB0"))
    assert "# 4800 baud, 7 even 2" in lines
    place = lines.index("> 4d 44 53 2c 30 34 0d 0a  MDS,04..")
    assert lines[place + 1] == "< 4f 4b 30 30 0d 0a  OK00..  after 0.050 s"


def test_a_port_that_fails_is_part_of_the_transcript() -> None:
    class Dying(MemoryLine):
        def write(self, data: bytes, timeout_s: float) -> None:
            raise DeviceLostError("the line is gone")

    def refuse(settings: PortSettings) -> MemoryLine:
        if settings == SEVEN_E_TWO:
            raise DeviceClaimedError("modem-manager holds the port")
        return Dying(Unknown(), VirtualClock())

    notes = [e.note for e in probe(refuse, DIALECTS, VirtualClock())]
    assert notes == ["modem-manager holds the port", "the line is gone"]
