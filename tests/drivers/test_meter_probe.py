"""Finding out what an unknown meter speaks: every byte is taken down, and nothing is changed for good."""

from __future__ import annotations

import io
from pathlib import Path

import pytest

from drivers.errors import DeviceClaimedError, DeviceLostError
from drivers.meter.dialect import SHIPPED, load_dialect
from drivers.meter.ls160 import KonicaMinoltaMeter
from drivers.meter.probe import LINE_ENDS, MAX_ANSWER_BYTES, SETTINGS, Exchange, greeted, probe, try_dialects
from drivers.serial_link import PortSettings
from drivers.transcript import RecordedLine, Transcript, read_transcript
from mocks.instruments.ls160 import SimulatedMeter
from mocks.instruments.serial_port import Instrument, Piece
from tests.drivers.memory_line import MemoryLine
from tests.mocks.instruments.recorded_meter import RecordedMeter
from tests.virtual_clock import VirtualClock

DIALECTS = tuple(load_dialect(name) for name in SHIPPED)
CHANGES = (b"CLE", b"CMS", b"CMW", b"LMW", b"CCW", b"MEM", b"ZRC", b"UCW", b"TDS", b"SPS", b"SCS")
"""Commands of the siblings that store, erase, calibrate or set."""


class Unknown:
    """A meter nobody has documented: it answers in several lines, or never ends."""

    line_end = b"\r\n"

    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def hear(self, line: bytes, now_s: float) -> list[Piece]:
        self.heard.append(line)
        if line == b"IDR":
            return [Piece(0.1, b"LS-160\r\n"), Piece(0.2, b"SN 12345678\r\n"), Piece(0.3, b"V1")]
        if line == b"RMT,0":
            return [Piece(0.0, b"U\n" * 4_000)]
        return []


def run(instrument: Instrument) -> list[Exchange]:
    clock = VirtualClock()
    return list(probe(lambda _settings: MemoryLine(instrument, clock), clock))


def test_every_setting_and_line_end_is_tried() -> None:
    tried = {(e.settings, e.line_end) for e in run(Unknown())}
    assert tried == {(s, end) for s in SETTINGS for end in LINE_ENDS}
    frames = {(s.baud, s.data_bits, s.parity) for s in SETTINGS}
    assert {(9600, 7, "even"), (38400, 7, "even"), (38400, 8, "none"), (9600, 8, "none")} <= frames


def test_the_questions_of_all_siblings_are_asked_and_nothing_that_stores_or_clears() -> None:
    instrument = Unknown()
    run(instrument)
    for question in (b"RMT,1", b"IDDR", b"MDS,04", b"RMTS,1", b"MEAS,1", b"COM,1", b"IDQ", b"MES,1", b"IDR", b"STR"):
        assert question in instrument.heard
    assert not [q for q in instrument.heard if q.startswith(CHANGES)]


def test_a_silent_line_is_given_up_soon() -> None:
    class Silent(Unknown):
        def hear(self, line: bytes, now_s: float) -> list[Piece]:
            return []

    clock = VirtualClock()
    assert not [e for e in probe(lambda _settings: MemoryLine(Silent(), clock), clock) if e.received]
    assert clock.monotonic_s() < 150


def test_all_lines_of_an_answer_are_taken_down_and_a_flood_is_bounded() -> None:
    by_question = {e.sent: e for e in run(Unknown()) if e.line_end == b"\r\n" and e.settings == SETTINGS[0]}
    assert by_question["IDR"].received == b"LS-160\r\nSN 12345678\r\nV1"
    assert 0 < len(by_question["RMT,0"].received) <= MAX_ANSWER_BYTES + 2
    assert by_question["RMT,1"].received == b""


@pytest.mark.parametrize("language", SHIPPED)
def test_each_known_meter_is_recognised_read_and_replayed(language: str, tmp_path: Path) -> None:
    """Only its own dialect fits; the transcript makes a meter that the driver reads the same from."""
    clock, file = VirtualClock(), io.StringIO()
    record = Transcript(file, clock)
    instrument = SimulatedMeter(lambda _t: 34.63, language=language, noise_frac=0, measuring_s=1.2)

    def open_line(settings: PortSettings) -> RecordedLine:
        return RecordedLine(MemoryLine(instrument, clock), record, "meter", str(settings.baud))

    exchanges = list(probe(open_line, clock))
    trials = {t.dialect.name: t.luminance_cd_m2 for t in try_dialects(open_line, DIALECTS, exchanges, clock)}
    assert {name for name, number in trials.items() if number is not None} == {language}
    assert trials[language] == pytest.approx(34.63)

    path = tmp_path / "transcript.jsonl"
    path.write_text(file.getvalue())
    replayed = RecordedMeter(read_transcript(path))
    meter = KonicaMinoltaMeter(lambda: MemoryLine(replayed, clock), load_dialect(language), clock)
    meter.connect()
    assert meter.measure().luminance_cd_m2 == trials[language]
    meter.close()


def test_a_greeting_is_the_whole_line_with_the_right_end() -> None:
    ls160 = load_dialect("ls160")
    for received, fits in (
        (b"OK00\r\n", True),
        (b"OK00\n", False),
        (b"xOK00\r\n", False),
        (b"OK00", False),
        (b"", False),
    ):
        assert greeted(ls160, [Exchange(SETTINGS[0], b"\r\n", "RMT,1", received)]) is fits
    assert not greeted(ls160, [Exchange(SETTINGS[0], b"\n", "RMT,1", b"OK00\r\n")])


def test_a_port_that_fails_is_part_of_the_transcript() -> None:
    class Dying(MemoryLine):
        def write(self, data: bytes, timeout_s: float) -> None:
            raise DeviceLostError("the line is gone")

    def refuse(settings: PortSettings) -> MemoryLine:
        if settings == SETTINGS[0]:
            raise DeviceClaimedError("modem-manager holds the port")
        return Dying(Unknown(), VirtualClock())

    notes = [e.note for e in probe(refuse, VirtualClock())]
    assert notes == ["modem-manager holds the port"] + ["the line is gone"] * (len(SETTINGS) - 1)
