"""Transcripts replayed as instruments: what passed on the instrument passes on its transcript, with the same frames."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from drivers.canon_5d2.camera import Canon5D2
from drivers.clock import Clock
from drivers.errors import DeviceTimeoutError, OperationRefusedError, ProtocolViolationError
from drivers.ptp.codes import Response
from drivers.ptp.pipes import PtpTransport
from drivers.ptp.session import PtpSession
from drivers.replay import ReplayedLine, ReplayedTransport
from drivers.theta_z1.camera import ThetaZ1
from drivers.transcript import Entry, RecordedTransport, Transcript, read_transcript
from drivers.usb_link import UsbLink
from mocks.instruments.canon_5d2 import SimulatedCanon5D2
from mocks.instruments.canon_records import CanonOptions
from mocks.instruments.theta_z1 import SimulatedThetaZ1
from mocks.instruments.usb.bus import SimulatedUsbBackend
from station.capture.conform import CameraBench, Outcome, run_camera
from station.capture.links import open_links, replayed_links
from station.capture.rig_file import PAPER_RIG
from station.errors import DiskFullError, ResourceError, UsageError
from station.session import durable
from station.session.session import Side
from tests.drivers.scripted import command, data, response
from tests.mocks.instruments.test_recorded_bodies import PAPER, THETA
from tests.mocks.optics.shot_sources import TinyShots
from tests.virtual_clock import VirtualClock

KINDS = ["canon, card", "canon, pc", "theta"]


def driver(kind: str, link: PtpTransport, clock: Clock) -> CameraBench:
    if kind == "theta":
        return CameraBench(ThetaZ1(lambda: link, clock), THETA, clock, may_delete=True)
    camera = Canon5D2(lambda: link, clock, destination="pc" if kind == "canon, pc" else "card")
    return CameraBench(camera, PAPER, clock, may_delete=True)


def record(kind: str, path: Path) -> list[Outcome]:
    """Run the conformance suite on a simulated camera and keep the transcript."""
    clock = VirtualClock()
    device = (
        SimulatedThetaZ1(TinyShots(), clock)
        if kind == "theta"
        else SimulatedCanon5D2(TinyShots(), clock, options=CanonOptions())
    )
    backend = SimulatedUsbBackend([device], clock)
    with path.open("w") as file:
        transcript = Transcript(file, clock)
        bench = driver(kind, None, clock)  # type: ignore[arg-type]

        def opened() -> PtpTransport:
            return RecordedTransport(
                UsbLink.open(*device.identity.usb_id, backend=backend, clock=clock), transcript, "it"
            )

        bench.camera._link._open_transport = opened  # type: ignore[attr-defined]
        return list(run_camera(bench))


@pytest.mark.parametrize("kind", KINDS)
def test_the_conformance_suite_passes_on_its_own_transcript(kind: str, tmp_path: Path) -> None:
    first = record(kind, tmp_path / "t.jsonl")
    assert all(o.passed for o in first), first
    clock = VirtualClock()
    link = ReplayedTransport(read_transcript(tmp_path / "t.jsonl"), clock, "it")
    second = list(run_camera(driver(kind, link, clock)))
    assert [(o.name, o.passed) for o in second] == [(o.name, True) for o in first], second
    said = {o.name: o.detail for o in first}
    for name in ("says_who_it_is", "takes_and_reads_back_settings", "reports_its_body", "has_the_bracket"):
        assert {o.name: o.detail for o in second}[name] == said[name]
    assert link.unknown == 0


def test_what_the_transcript_has_not_is_refused_not_invented(tmp_path: Path) -> None:
    record("theta", tmp_path / "t.jsonl")
    clock = VirtualClock()
    link = ReplayedTransport(read_transcript(tmp_path / "t.jsonl"), clock, "it")
    link.write(struct.pack("<IHHI", 12, 1, 0x1013, 7), 1.0)  # PowerDown
    assert link.read(512, 1.0) == struct.pack("<IHHI", 12, 3, Response.INVALID_PARAMETER, 7)
    assert link.unknown == 1
    with pytest.raises(DeviceTimeoutError):
        link.read(512, 1.0)
    assert link.read_event(0.1) is None


def test_a_picture_may_be_fetched_in_other_pieces_than_then() -> None:
    """A capture takes smaller ones while a camera exposes: which they are goes by the moment."""
    picture, clock = bytes(range(250)) * 10, VirtualClock()
    entries = [Entry(0, "it", "out", command(0x1002, 0, 1)), Entry(0, "it", "in", response(0x2001, 0))]
    for number, (at, size) in enumerate([(0, 700), (700, 1000), (1700, 1000)], 1):
        part = picture[at : at + size]
        entries.append(Entry(number, "it", "out", command(0x101B, number, 5, at, size)))
        entries.append(Entry(number, "it", "in", data(0x101B, number, part)))
        entries.append(Entry(number, "it", "in", response(0x2001, number, len(part))))
    entries.append(Entry(9, "it", "out", command(0x101B, 4, 6, 0, 100)))
    entries.append(Entry(9, "it", "in", response(0x2019, 4)))
    session = PtpSession(ReplayedTransport(entries, clock, "it"), clock, name="it")
    session.open()
    for size in (100, 700, 999, 2500):
        found = b"".join(session.get_partial_object(5, at, size) for at in range(0, len(picture), size))
        assert found == picture
    for handle, at in ((5, len(picture)), (6, 10), (7, 0)):
        with pytest.raises(OperationRefusedError):
            session.get_partial_object(handle, at, 100)


def test_a_line_answers_as_late_as_it_did() -> None:
    entries = [
        Entry(0.0, "meter", "out", b"MES\r\n"),
        Entry(1.5, "meter", "in", b"OK00,c  1.5\r\n"),
        Entry(2.0, "meter", "out", b"MES\r\n"),
        Entry(2.1, "meter", "in", b"ER02\r\n"),
    ]
    clock = VirtualClock()
    line = ReplayedLine(entries, clock, "meter")
    lines = []
    for _ in range(3):  # the last answer stands for all that come after it
        start_s = clock.monotonic_s()
        line.write(b"MES\r\n", 1.0)
        lines.append((line.read_line(b"\r\n", 80, 5.0), round(clock.monotonic_s() - start_s, 6)))
    assert lines == [(b"OK00,c  1.5", 1.5), (b"ER02", 0.1), (b"ER02", 0.1)]
    line.write(b"IDDR\r\n", 1.0)
    with pytest.raises(DeviceTimeoutError):
        line.read_line(b"\r\n", 80, 5.0)


def test_a_transcript_knows_its_rig_but_not_its_place(tmp_path: Path) -> None:
    path, clock = tmp_path / "t.jsonl.gz", VirtualClock()
    links = open_links(path, PAPER_RIG.model_copy(update={"heading_deg": 12.0}), clock, simulated=False)
    links.close()
    again, rig = replayed_links(path)
    assert (rig.indoor, rig.outdoor, rig.meter) == (None, None, None), "none of them is in it"
    assert rig.heading_deg is None
    assert not again.simulated
    with pytest.raises(UsageError, match="is already there"):
        open_links(path, PAPER_RIG, clock, simulated=False)
    with pytest.raises(ResourceError, match="creating failed"):
        open_links(tmp_path / "no folder" / "t.jsonl", PAPER_RIG, clock, simulated=False)
    (tmp_path / "other.jsonl").write_text('{"t": 0, "who": "meter", "way": "open"}\n')
    with pytest.raises(ProtocolViolationError, match="does not start with the rig"):
        replayed_links(tmp_path / "other.jsonl")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_costs_the_transcript_and_not_the_capture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(durable, "new_file", lambda _path: open("/dev/full", "w"))  # noqa: SIM115
    clock = VirtualClock()
    links = open_links(Path("t.jsonl"), PAPER_RIG, clock, simulated=False)
    device = SimulatedThetaZ1(TinyShots(), clock)
    backend = SimulatedUsbBackend([device], clock)
    usb_id = device.identity.usb_id
    camera = ThetaZ1(
        lambda: links.camera(Side.INDOOR, lambda: UsbLink.open(*usb_id, backend=backend, clock=clock)), clock
    )
    outcomes = list(run_camera(CameraBench(camera, THETA, clock)))
    assert all(o.passed for o in outcomes), outcomes
    with pytest.raises(DiskFullError, match="recording failed"):
        links.close()
