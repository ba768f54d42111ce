"""Transcripts: what a link did is on disk, byte for byte, in order and with times; what is no transcript is named."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from drivers.errors import DeviceTimeoutError, ProtocolViolationError
from drivers.transcript import Entry, RecordedLine, RecordedTransport, Transcript, read_transcript
from mocks.instruments.ls160 import SimulatedMeter
from tests.drivers.memory_line import MemoryLine
from tests.drivers.scripted import FakeClock, OnEvent, ScriptedTransport, Step


def test_a_camera_link_is_written_down(tmp_path: Path) -> None:
    clock = FakeClock()
    inner = ScriptedTransport(
        [Step(b"ask", [b"answer", OnEvent(b"event")]), Step(b"more", [DeviceTimeoutError("none")])]
    )
    with (tmp_path / "t.jsonl").open("w") as file:
        link = RecordedTransport(inner, Transcript(file, clock), "outdoor")
        clock.sleep(1.5)
        link.write(b"ask", 1.0)
        assert (link.read(512, 1.0), link.read_event(0.1), link.read_event(0.1)) == (b"answer", b"event", None)
        link.write(b"more", 1.0)
        with pytest.raises(DeviceTimeoutError):
            link.read(512, 1.0)
        link.close()
    entries = list(read_transcript(tmp_path / "t.jsonl"))
    assert [(e.way, e.data, e.error) for e in entries] == [
        ("open", b"", ""),
        ("out", b"ask", ""),
        ("in", b"answer", ""),
        ("event", b"event", ""),
        ("out", b"more", ""),
        ("in", b"", "DEV-005"),
        ("close", b"", ""),
    ]
    assert entries[1].t_s == 1.5
    assert {e.who for e in entries} == {"outdoor"}


def test_a_serial_line_is_written_down_with_its_delimiters(tmp_path: Path) -> None:
    with gzip.open(tmp_path / "t.jsonl.gz", "wt") as file:
        inner = MemoryLine(SimulatedMeter(lambda _t_s: 1.5, language="ls100", noise_frac=0.0), FakeClock())
        line = RecordedLine(inner, Transcript(file, FakeClock()), "meter", "4800 7E2")
        line.write(b"MES\r\n", 1.0)
        answer = line.read_line(b"\r\n", 80, 10.0)
    opened, sent, came = read_transcript(tmp_path / "t.jsonl.gz")
    assert opened.info["settings"] == "4800 7E2"
    assert answer.startswith(b"OK00,")
    assert (sent.data, came.data) == (b"MES\r\n", answer + b"\r\n")


@pytest.mark.parametrize("text", ["{", "[]", '{"t": 1}', '{"t": 1, "who": "a", "way": "in", "hex": "0"}', "[" * 99999])
def test_what_is_no_transcript_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "t.jsonl"
    path.write_text('{"t": 0, "who": "meter", "way": "open"}\n' + text)
    entries = read_transcript(path)
    assert next(entries) == Entry(0.0, "meter", "open")
    with pytest.raises(ProtocolViolationError, match="line 2 is not a transcript line"):
        next(entries)


def test_a_compressed_transcript_of_a_program_that_was_killed_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    path, killed, damaged = (tmp_path / f"{name}.jsonl.gz" for name in ("whole", "killed", "damaged"))
    with gzip.open(path, "wt") as file:
        transcript = Transcript(file, FakeClock())
        for number in range(100):
            transcript.write("outdoor", "out", bytes([number]))
        killed.write_bytes(path.read_bytes())
    whole = list(read_transcript(path))
    assert len(whole) == 100
    assert list(read_transcript(killed)) == whole
    raw = bytearray(path.read_bytes())
    raw[200:230] = bytes(30)
    damaged.write_bytes(raw)
    with pytest.raises(ProtocolViolationError, match="not a transcript line"):
        list(read_transcript(damaged))
