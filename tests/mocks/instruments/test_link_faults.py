"""Every fault of the link really happens, at its byte and at its occurrence, seen through pyusb."""

from __future__ import annotations

import errno

import pytest

from drivers.ptp.codes import Response
from mocks.instruments.faults import Fault, FaultKind, Phase
from tests.mocks.instruments.echo import GIVE, KEEP, SIGNAL, Echo
from tests.mocks.instruments.test_usb_bus import EVENT, OPEN_SESSION, Bench, failing

RESPONSE_1 = bytes.fromhex("0c 00 00 00 03 00 01 20 01 00 00 00")


def bench_with(*faults: Fault) -> Bench:
    bench = Bench()
    bench.camera = Echo(bench.clock, *faults)
    bench.backend = type(bench.backend)([bench.camera], bench.clock)
    bench.device = bench.find()
    return bench


def fired(bench: Bench) -> list[FaultKind]:
    return [f.kind for f in bench.camera.faults.fired]


def give(kind: FaultKind, *, size: int = 1000, phase: Phase = Phase.DATA, byte: int = 0, **parameters: float) -> Bench:
    """Return a bench after the command of a transaction that goes wrong."""
    bench = bench_with(Fault(kind, GIVE, phase=phase, byte=byte, parameters=parameters))
    bench.open()
    bench.command(GIVE, 1, size)
    return bench


@pytest.mark.parametrize("byte", [0, 1, 511, 512, 513, 1011, 5000])
def test_unplug_at_a_byte_of_the_data(byte: int) -> None:
    bench = give(FaultKind.UNPLUG, byte=byte, replug_after_s=2)
    whole_reads = min(byte, 1012) // 512 + (byte >= 1012)
    got = b"".join(bench.read() for _ in range(whole_reads))
    assert got[12:] == bytes(i % 251 for i in range(1000))[: max(0, len(got) - 12)]
    assert failing(bench.read) == errno.ENODEV
    assert fired(bench) == [FaultKind.UNPLUG]
    bench.clock.sleep(3)
    bench.device = bench.find()
    bench.open()


@pytest.mark.parametrize(("phase", "byte"), [(Phase.COMMAND, 0), (Phase.COMMAND, 99), (Phase.RESPONSE, 5)])
def test_unplug_in_other_phases(phase: Phase, byte: int) -> None:
    bench = bench_with(Fault(FaultKind.UNPLUG, GIVE, phase=phase, byte=byte))
    bench.open()
    if phase is Phase.COMMAND:
        assert failing(lambda: bench.command(GIVE, 1, 8)) == errno.ENODEV
        assert bench.camera.stats.count(GIVE) == int(byte > 16), "a command that went through is carried out"
    else:
        bench.command(GIVE, 1, 8)
        bench.read()
        assert failing(bench.read) == errno.ENODEV
    assert fired(bench) == [FaultKind.UNPLUG]


@pytest.mark.parametrize("byte", [0, 600, 3000])
def test_unplug_in_the_data_that_the_host_sends(byte: int) -> None:
    bench = bench_with(Fault(FaultKind.UNPLUG, KEEP, phase=Phase.DATA, byte=byte))
    bench.open()
    bench.command(KEEP, 1)
    whole = (12 + 1000).to_bytes(4, "little") + bytes.fromhex("02 00 00 90 01 00 00 00") + bytes(1000)
    assert failing(lambda: bench.write(whole)) == errno.ENODEV
    assert bench.camera.kept == b""
    assert fired(bench) == [FaultKind.UNPLUG]


@pytest.mark.parametrize("phase", [Phase.COMMAND, Phase.DATA, Phase.RESPONSE])
def test_stall_and_clear(phase: Phase) -> None:
    bench = bench_with(Fault(FaultKind.STALL, GIVE, phase=phase))
    bench.open()
    if phase is Phase.COMMAND:
        assert failing(lambda: bench.command(GIVE, 1, 8)) == errno.EPIPE
        assert failing(lambda: bench.command(GIVE, 1, 8)) == errno.EPIPE
        bench.device.clear_halt(0x02)
        bench.command(GIVE, 1, 8)
    else:
        bench.command(GIVE, 1, 8)
        if phase is Phase.RESPONSE:
            assert len(bench.read()) == 20
        assert failing(bench.read) == errno.EPIPE
        assert failing(bench.read) == errno.EPIPE
        bench.device.clear_halt(0x81)
    if phase is not Phase.RESPONSE:
        assert len(bench.read()) == 20
    assert bench.read() == RESPONSE_1
    assert fired(bench) == [FaultKind.STALL]


def test_no_answer_until_the_next_command() -> None:
    bench = give(FaultKind.NO_ANSWER)
    assert failing(bench.read) == errno.ETIMEDOUT
    bench.command(GIVE, 2, 8)
    assert bench.read()[8:12] == b"\2\0\0\0"
    assert fired(bench) == [FaultKind.NO_ANSWER]


def test_no_answer_until_a_reset() -> None:
    fault = Fault(FaultKind.NO_ANSWER, GIVE, parameters={"until": "reset"})
    bench = bench_with(fault)
    bench.open()
    bench.command(GIVE, 1, 8)
    bench.command(GIVE, 2, 8)
    assert failing(bench.read) == errno.ETIMEDOUT
    bench.device.ctrl_transfer(0x21, 0x66, 0, 0, b"", 1000)
    bench.open()


def test_a_late_answer_comes_before_the_next() -> None:
    bench = give(FaultKind.LATE_ANSWER, size=8)
    assert failing(bench.read) == errno.ETIMEDOUT
    bench.command(GIVE, 2, 8)
    ids = [bench.read()[8] for _ in range(4)]
    assert ids == [1, 1, 2, 2]
    assert fired(bench) == [FaultKind.LATE_ANSWER]


def test_short_data() -> None:
    bench = give(FaultKind.SHORT_DATA, missing_bytes=100)
    data = bench.read(4096)
    assert (len(data), data[:4]) == (912, (1012).to_bytes(4, "little"))
    assert bench.read() == RESPONSE_1
    assert fired(bench) == [FaultKind.SHORT_DATA]


@pytest.mark.parametrize(
    ("kind", "length"), [(FaultKind.OVERSIZE_LENGTH, 1012 + 64), (FaultKind.UNKNOWN_LENGTH, 0xFFFFFFFF)]
)
def test_lengths_that_lie(kind: FaultKind, length: int) -> None:
    bench = give(kind)
    data = bench.read(4096)
    assert (len(data), data[:4]) == (1012, length.to_bytes(4, "little"))
    assert fired(bench) == [kind]


@pytest.mark.parametrize("phase", [Phase.DATA, Phase.RESPONSE])
@pytest.mark.parametrize(
    ("kind", "at", "wrong"),
    [
        (FaultKind.WRONG_TYPE, 4, b"\4\0"),
        (FaultKind.WRONG_CODE, 6, b"\xff\x2f"),
        (FaultKind.WRONG_TRANSACTION_ID, 8, b"\2\0\0\0"),
    ],
)
def test_wrong_header_fields(kind: FaultKind, at: int, wrong: bytes, phase: Phase) -> None:
    bench = give(kind, phase=phase)
    data, response = bench.read(4096), bench.read()
    spoiled, clean = (data, response) if phase is Phase.DATA else (response, data)
    assert spoiled[at : at + len(wrong)] == wrong
    assert clean[at : at + len(wrong)] != wrong
    assert fired(bench) == [kind]


def test_duplicate_response() -> None:
    bench = give(FaultKind.DUPLICATE_RESPONSE)
    bench.read(4096)
    assert [bench.read(), bench.read()] == [RESPONSE_1, RESPONSE_1]
    assert fired(bench) == [FaultKind.DUPLICATE_RESPONSE]


def test_response_before_data() -> None:
    bench = give(FaultKind.RESPONSE_BEFORE_DATA)
    assert bench.read(4096) == RESPONSE_1
    assert len(bench.read(4096)) == 1012
    assert fired(bench) == [FaultKind.RESPONSE_BEFORE_DATA]


def test_missing_zero_length_packet_joins_data_and_response() -> None:
    bench = give(FaultKind.MISSING_ZLP, size=1012)
    assert bench.read(4096)[1024:] == RESPONSE_1
    assert fired(bench) == [FaultKind.MISSING_ZLP]
    bench = give(FaultKind.MISSING_ZLP, size=1000)
    bench.read(4096)
    assert fired(bench) == [], "there was none to leave out"


def test_split_header() -> None:
    bench = give(FaultKind.SPLIT_HEADER)
    assert len(bench.read(4096)) == 12
    assert len(bench.read(4096)) == 1000
    assert bench.read() == RESPONSE_1
    assert fired(bench) == [FaultKind.SPLIT_HEADER]


def test_garbage() -> None:
    bench = give(FaultKind.GARBAGE, count=40)
    assert len(bench.read(4096)) == 40
    assert len(bench.read(4096)) == 1012
    assert fired(bench) == [FaultKind.GARBAGE]


def test_busy_a_number_of_times_from_the_nth() -> None:
    bench = bench_with(Fault(FaultKind.BUSY, GIVE, nth=2, times=3))
    bench.open()
    codes = []
    for transaction_id in range(1, 7):
        bench.command(GIVE, transaction_id, 8)
        first = bench.read()
        codes.append(int.from_bytes((first if len(first) == 12 else bench.read())[6:8], "little"))
    assert codes == [Response.OK, *[Response.DEVICE_BUSY] * 3, Response.OK, Response.OK]
    assert fired(bench) == [FaultKind.BUSY] * 3


def test_access_denied() -> None:
    bench = give(FaultKind.ACCESS_DENIED)
    assert bench.read()[6:8] == bytes.fromhex("0f 20")
    assert fired(bench) == [FaultKind.ACCESS_DENIED]


def test_a_session_left_open_accepts_whatever_id_comes_next() -> None:
    bench = bench_with(Fault(FaultKind.SESSION_ALREADY_OPEN))
    bench.write(OPEN_SESSION)
    assert bench.read()[6:8] == bytes.fromhex("1e 20")
    bench.command(GIVE, 41, 8)
    assert len(bench.read()) == 20
    assert fired(bench) == [FaultKind.SESSION_ALREADY_OPEN]


def test_slow_transfer_for_a_while() -> None:
    slow = Fault(FaultKind.SLOW_TRANSFER, GIVE, parameters={"factor": 10, "for_operations": 1})
    bench = bench_with(slow)
    bench.open()
    took_s = []
    for transaction_id in (1, 2):
        before_s = bench.clock.monotonic_s()
        bench.command(GIVE, transaction_id, 50_000)
        bench.read(65536)
        took_s.append(bench.clock.monotonic_s() - before_s)
        bench.read()
    assert took_s == [pytest.approx(0.5, rel=0.05), pytest.approx(0.05, rel=0.05)]
    assert fired(bench) == [FaultKind.SLOW_TRANSFER]


def events_of(bench: Bench, count: int) -> list[int]:
    """Send ``count`` events (object 100, 101, ...) and return the first parameters of those that come."""
    bench.open()
    for n in range(count):
        bench.command(SIGNAL, n + 1, 0x4002, 100 + n)
        bench.read()
    got = []
    while True:
        try:
            got.append(int.from_bytes(bench.read(16, EVENT, 5)[12:], "little"))
        except OSError:
            return got


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        (FaultKind.LOST_EVENT, [100, 102]),
        (FaultKind.DUPLICATE_EVENT, [100, 101, 101, 102]),
        (FaultKind.OTHER_OBJECT_EVENT, [100, 1101, 102]),
        (FaultKind.REORDERED_EVENT, [100, 102, 101]),
    ],
)
def test_event_faults(kind: FaultKind, expected: list[int]) -> None:
    bench = bench_with(Fault(kind, 0x4002, nth=2))
    assert events_of(bench, 3) == expected
    assert fired(bench) == [kind]


def test_an_event_held_back_comes_in_the_end() -> None:
    bench = bench_with(Fault(FaultKind.REORDERED_EVENT, 0x4002))
    assert events_of(bench, 1) == []
    bench.clock.sleep(0.6)
    assert bench.read(16, EVENT)[12] == 100


@pytest.mark.parametrize(("kind", "number"), [(FaultKind.UNPLUG, errno.ENODEV), (FaultKind.STALL, errno.EPIPE)])
def test_the_link_breaks_while_an_event_is_read(kind: FaultKind, number: int) -> None:
    bench = bench_with(Fault(kind, 0x4002, phase=Phase.EVENT, byte=8))
    bench.open()
    bench.command(SIGNAL, 1, 0x4002, 7)
    bench.read()
    assert len(bench.read(8, EVENT)) == 8
    assert failing(lambda: bench.read(8, EVENT)) == number
    assert fired(bench) == [kind]
