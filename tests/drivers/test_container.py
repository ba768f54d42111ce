from __future__ import annotations

import struct
import tracemalloc

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from drivers.errors import ProtocolViolationError
from drivers.ptp.codes import ContainerType
from drivers.ptp.container import (
    MAX_EMPTY_TRANSFERS,
    BulkAssembler,
    Container,
    EventAssembler,
    Header,
    decode,
    decode_header,
    encode,
    pack_params,
    unpack_params,
)
from tests.drivers import scripted

COMMAND, DATA, RESPONSE, EVENT = ContainerType

# devices.md 4.6, and 3.7 for the Canon ones.
VECTORS = {
    "OpenSession(1)": ("10000000 0100 0210 00000000 01000000", COMMAND, 0x1002, 0, "01000000"),
    "GetDeviceInfo": ("0c000000 0100 0110 00000000", COMMAND, 0x1001, 0, ""),
    "OK": ("0c000000 0300 0120 00000000", RESPONSE, 0x2001, 0, ""),
    "DeviceBusy": ("0c000000 0300 1920 07000000", RESPONSE, 0x2019, 7, ""),
    "Theta SetDevicePropValue D00F": ("10000000 0100 1610 09000000 0fd00000", COMMAND, 0x1016, 9, "0fd00000"),
    "its data, 1/60 s": ("14000000 0200 1610 09000000 01000000 3c000000", DATA, 0x1016, 9, "010000003c000000"),
    "InitiateCapture(0, 0)": ("14000000 0100 0e10 0a000000 00000000 00000000", COMMAND, 0x100E, 10, "00" * 8),
    "ObjectAdded": ("10000000 0400 0240 0a000000 64000000", EVENT, 0x4002, 10, "64000000"),
    "CaptureComplete": ("10000000 0400 0d40 0a000000 0a000000", EVENT, 0x400D, 10, "0a000000"),
    "Canon 9110": ("0c000000 0100 1091 14000000", COMMAND, 0x9110, 0x14, ""),
    "its data, D102 = 1/60": (
        "18000000 0200 1091 14000000 0c000000 02d10000 68000000",
        DATA,
        0x9110,
        0x14,
        "0c00000002d1000068000000",
    ),
    "Canon 9128(2, 0)": ("14000000 0100 2891 15000000 02000000 00000000", COMMAND, 0x9128, 0x15, "0200000000000000"),
}


@pytest.mark.parametrize("name", VECTORS)
def test_byte_vectors_both_ways(name: str) -> None:
    wire_hex, kind, code, transaction_id, payload_hex = VECTORS[name]
    whole = Container(kind, code, transaction_id, bytes.fromhex(payload_hex))
    wire = bytes.fromhex(wire_hex)
    assert encode(whole) == wire
    assert decode(wire) == whole


payloads = st.binary(max_size=2000)
ids = st.integers(0, 0xFFFFFFFF)
codes = st.integers(0, 0xFFFF)


@st.composite
def containers(draw: st.DrawFn) -> Container:
    kind = draw(st.sampled_from(ContainerType))
    if kind is DATA:
        return Container(kind, draw(codes), draw(ids), draw(payloads))
    words = draw(st.lists(ids, max_size=3 if kind is EVENT else 5))
    return Container(kind, draw(codes), draw(ids), pack_params(words))


@given(containers())
def test_decode_undoes_encode(whole: Container) -> None:
    assert decode(encode(whole)) == whole


@given(st.binary(max_size=64) | st.builds(scripted.container, st.integers(0, 6), codes, ids, payloads, length=ids))
def test_any_bytes_decode_or_are_a_violation(wire: bytes) -> None:
    try:
        whole = decode(wire)
    except ProtocolViolationError:
        return
    assert whole.payload == wire[12:]


@given(st.binary(max_size=40))
def test_params_are_whole_words(payload: bytes) -> None:
    if len(payload) % 4 or len(payload) > 20:
        with pytest.raises(ProtocolViolationError):
            unpack_params(payload)
    else:
        assert pack_params(unpack_params(payload)) == payload


@pytest.mark.parametrize("params", [(1, 2, 3, 4, 5, 6), (-1,), (2**32,)])
def test_params_that_ptp_cannot_carry(params: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="parameters"):
        pack_params(params)


@pytest.mark.parametrize(
    "whole",
    [Container(RESPONSE, 0x2001, 1, bytes(24)), Container(EVENT, 0x4002, 1, bytes(16)), Container(COMMAND, 1, 1, b"x")],
)
def test_payloads_that_ptp_cannot_carry(whole: Container) -> None:
    with pytest.raises(ValueError, match="cannot carry"):
        encode(whole)


@pytest.mark.parametrize(
    ("wire", "said"),
    [
        (b"", "too few"),
        (bytes(11), "too few"),
        (scripted.container(0, 0x2001, 1), "type 0"),
        (scripted.container(5, 0x2001, 1), "type 5"),
        (scripted.container(2, 0x1001, 1, length=11), "shorter than its own header"),
        (scripted.container(3, 0x2001, 1, length=0), "cannot be 0 bytes"),
        (scripted.container(3, 0x2001, 1, length=36), "cannot be 36 bytes"),
        (scripted.container(3, 0x2001, 1, length=14), "cannot be 14 bytes"),
        (scripted.container(3, 0x2001, 1, length=0xFFFFFFFF), "cannot be 4294967295 bytes"),
        (scripted.container(4, 0x4002, 1, length=28), "cannot be 28 bytes"),
    ],
)
def test_wrong_headers_say_what_is_wrong(wire: bytes, said: str) -> None:
    with pytest.raises(ProtocolViolationError, match=said):
        decode_header(wire)


def test_length_of_a_container_is_checked_to_the_byte() -> None:
    with pytest.raises(ProtocolViolationError, match="announces 16 bytes and has 15"):
        decode(scripted.response(0x2001, 1, 7)[:-1])
    with pytest.raises(ProtocolViolationError, match="announces 16 bytes and has 17"):
        decode(scripted.response(0x2001, 1, 7) + b"\0")


# Bulk-in, cut in every way.


def admit_all(header: Header) -> int:
    return 4096 if header.type is DATA else 20


def assemble(transfers: list[bytes], packet: int = 512) -> list[Container]:
    assembler = BulkAssembler(packet)
    found: list[Container] = []
    for transfer in transfers:
        assembler.feed(transfer)
        while (whole := assembler.take(admit_all)) is not None:
            found.append(whole)
    assert not assembler.in_pieces
    return found


BODY = bytes(range(256)) * 4


def feed_for_ever(assembler: BulkAssembler, transfer: bytes) -> None:
    for _ in range(100_000):
        assembler.feed(transfer)
        assembler.take(admit_all)


OBJECT = Container(DATA, 0x1009, 3, BODY[:1000])
DONE = Container(RESPONSE, 0x2001, 3, pack_params([1000]))
WIRE = encode(OBJECT) + encode(DONE)
FULL = Container(DATA, 0x1009, 3, BODY[: 1024 - 12])


@pytest.mark.parametrize(
    "transfers",
    [
        pytest.param([encode(OBJECT), encode(DONE)], id="usual"),
        pytest.param([WIRE], id="response merged into the data's read"),
        pytest.param([encode(OBJECT)[:12], encode(OBJECT)[12:], encode(DONE)], id="split header"),
        pytest.param([b"", encode(OBJECT), encode(DONE)], id="leading zero-length packet"),
        pytest.param([encode(OBJECT), b"", encode(DONE)], id="zero-length packet before the response"),
        pytest.param([WIRE[i : i + 1] for i in range(len(WIRE))], id="byte by byte"),
        pytest.param([WIRE[i : i + 512] for i in range(0, len(WIRE), 512)], id="packet by packet"),
    ],
)
def test_ways_in_which_cameras_cut(transfers: list[bytes]) -> None:
    assert assemble(transfers) == [OBJECT, DONE]


@pytest.mark.parametrize("closing", [[], [b""]], ids=["without", "with"])
def test_data_that_fills_its_last_packet(closing: list[bytes]) -> None:
    assert len(encode(FULL)) % 512 == 0
    assert assemble([encode(FULL), *closing, encode(DONE)]) == [FULL, DONE]


@given(
    st.lists(st.builds(Container, st.just(DATA), codes, ids, payloads), min_size=1, max_size=3),
    st.lists(st.integers(0, 900), max_size=30),
)
@settings(max_examples=200)
def test_any_cutting_gives_the_same_containers(wholes: list[Container], sizes: list[int]) -> None:
    stream = b"".join(map(encode, wholes))
    transfers, at = [], 0
    for size in sizes:
        transfers.append(stream[at : at + size])
        at += size
    transfers.append(stream[at:])
    runs_of_empty = max(len(run) for run in "".join("0" if t else "1" for t in transfers).split("0"))
    assume(runs_of_empty <= MAX_EMPTY_TRANSFERS)
    assert assemble(transfers) == wholes


@pytest.mark.parametrize("size", [0, 1, 499, 500, 501, 1011, 1012, 1013, 2000])
@pytest.mark.parametrize("split", [False, True])
def test_unknown_length_runs_until_a_short_packet(size: int, split: bool) -> None:
    body = (BODY * 2)[:size]
    header = scripted.container(2, 0x1009, 3, length=0xFFFFFFFF)
    stream = body if split else header + body
    transfers = [stream[i : i + 512] for i in range(0, len(stream), 512)]
    if len(stream) % 512 == 0 or (not split and size == 0):
        transfers.append(b"")
    if split:
        transfers.insert(0, header)
    assert assemble([*transfers, encode(DONE)]) == [Container(DATA, 0x1009, 3, body), DONE]


def test_unknown_length_is_bounded() -> None:
    assembler = BulkAssembler(512)
    assembler.feed(scripted.container(2, 0x1009, 3, bytes(500), length=0xFFFFFFFF))
    tracemalloc.start()
    with pytest.raises(ProtocolViolationError, match="runs past 4096 bytes"):
        feed_for_ever(assembler, bytes(512))
    assert tracemalloc.get_traced_memory()[1] < 64 * 1024
    tracemalloc.stop()


def test_announced_length_is_refused_before_anything_is_stored() -> None:
    assembler = BulkAssembler(512)
    assembler.feed(scripted.container(2, 0x1009, 3, length=0xFFFFFFFE))
    tracemalloc.start()
    with pytest.raises(ProtocolViolationError, match="at most 4096 are due"):
        assembler.take(admit_all)
    assert tracemalloc.get_traced_memory()[1] < 64 * 1024
    tracemalloc.stop()


def test_skipped_container_is_not_stored() -> None:
    assembler = BulkAssembler(512)
    total = 50_000_000
    assembler.feed(scripted.container(2, 0x1009, 2, length=12 + total))
    piece = bytes(500_000)
    tracemalloc.start()
    for _ in range(total // len(piece)):
        assert assembler.take(lambda _: None) is None
        assembler.feed(piece)
    assembler.feed(encode(DONE))
    assert assembler.take(lambda h: None if h.transaction_id == 2 else 20) == DONE
    assert tracemalloc.get_traced_memory()[1] < 3_000_000
    tracemalloc.stop()


@pytest.mark.parametrize("received_bytes", [0, 500, 688])
def test_response_where_data_is_missing_is_noticed_at_once(received_bytes: int) -> None:
    assembler = BulkAssembler(512)
    assembler.feed(encode(OBJECT)[: 12 + received_bytes])
    assert assembler.take(admit_all) is None
    assembler.feed(b"")
    with pytest.raises(ProtocolViolationError, match="ended before its announced length") as caught:
        assembler.feed(encode(DONE))
    assert caught.value.details["received_bytes"] == received_bytes


def test_zero_length_packets_without_end_are_a_violation() -> None:
    assembler = BulkAssembler(512)
    with pytest.raises(ProtocolViolationError, match=f"more than {MAX_EMPTY_TRANSFERS} empty transfers"):
        feed_for_ever(assembler, b"")


@pytest.mark.parametrize("wire", [scripted.command(0x1001, 1), scripted.event(0x4002, 1)])
def test_bulk_in_carries_data_and_responses_only(wire: bytes) -> None:
    with pytest.raises(ProtocolViolationError, match="cannot come from bulk-in"):
        assemble([wire])


@given(st.lists(st.binary(max_size=600), max_size=12))
def test_any_transfers_assemble_or_are_a_violation(transfers: list[bytes]) -> None:
    assembler = BulkAssembler(512)
    try:
        for transfer in transfers:
            assembler.feed(transfer)
            while assembler.take(admit_all) is not None:
                pass
    except ProtocolViolationError:
        assembler.reset()
        assembler.feed(encode(DONE))
        assert assembler.take(admit_all) == DONE


# Events.

events = st.builds(
    Container,
    st.just(EVENT),
    st.sampled_from([0x4002, 0x400D, 0xC101]),
    ids,
    st.lists(ids, max_size=3).map(pack_params),
)


@given(st.lists(events, max_size=6), st.sampled_from([8, 16, 64, 512]))
def test_events_in_packets_of_any_size(wholes: list[Container], packet: int) -> None:
    assembler = EventAssembler()
    found = []
    for whole in wholes:
        wire = encode(whole)
        for i in range(0, len(wire), packet):
            found += assembler.feed(wire[i : i + packet])
    assert found == wholes
    assert assembler.garbled == 0
    assert not assembler.in_pieces


def test_events_glued_together() -> None:
    first, second = Container(EVENT, 0x4002, 10, pack_params([100])), Container(EVENT, 0x400D, 10, pack_params([10]))
    assert EventAssembler().feed(encode(first) + encode(second)) == [first, second]


def test_event_cut_off_by_the_next_one_is_counted() -> None:
    assembler = EventAssembler()
    whole = Container(EVENT, 0x4002, 10, pack_params([100]))
    assert assembler.feed(encode(whole)[:8]) == []
    assert assembler.feed(encode(whole)[:8]) == []
    assert assembler.feed(encode(whole)[8:]) == [whole]
    assert assembler.garbled == 1


@given(st.lists(st.binary(max_size=40), max_size=10))
def test_any_interrupt_bytes_give_events_or_are_counted(pieces: list[bytes]) -> None:
    assembler = EventAssembler()
    for piece in pieces:
        for found in assembler.feed(piece):
            assert found.type is EVENT
            assert len(found.payload) <= 12
        assert len(assembler._raw) < 64
    assembler.reset()
    assert len(assembler.feed(scripted.event(0x4002, 1, 2))) == 1


def test_header_of_a_vector_reads_as_documented() -> None:
    header = decode_header(struct.pack("<IHHI", 24, 2, 0x9110, 0x14))
    assert (header.payload_bytes, header.unbounded) == (12, False)
