"""Canon's encodings against the published vectors, the whole code tables, and any bytes at all."""

from __future__ import annotations

import math
import struct
import time
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera import nearest_time
from drivers.canon_5d2.codes import (
    APERTURE_CODES,
    ISO_CODES,
    SHUTTER_CODES,
    SHUTTER_CODES_HALF,
    CanonEvent,
    CanonProp,
)
from drivers.canon_5d2.operations import (
    JPEG_LARGE_FINE,
    RAW_FULL,
    AvailableValues,
    ImageFile,
    NumberRecord,
    ObjectRecord,
    OtherRecord,
    PropValue,
    decode_events,
    decode_image_format,
    encode_image_format,
    encode_number,
    encode_property,
)
from drivers.canon_5d2.settings import (
    SHUTTER_S,
    aperture_code,
    aperture_text,
    camera_time_utc,
    image_format_text,
    iso_code,
    iso_text,
    release_problem,
    shutter_codes_known,
)
from drivers.errors import ProtocolViolationError

END_OF_STREAM = bytes.fromhex("08000000 00000000")
PAPER_STOPS = {
    4: 0x28,
    1: 0x38,
    1 / 4: 0x48,
    1 / 15: 0x58,
    1 / 60: 0x68,
    1 / 250: 0x78,
    1 / 1000: 0x88,
    1 / 4000: 0x98,
    1 / 8000: 0xA0,
}

VALUE_60 = bytes.fromhex("10000000 89c10000 02d10000 68000000")
LIST_TWO = bytes.fromhex("1c000000 8ac10000 02d10000 03000000 02000000 28000000 38000000")
BUSY = bytes.fromhex("0c000000 8bc10000 01000000")
WANTS_TRANSFER = bytes.fromhex(
    "2c000000 86c10000 01009091 03b10000 00000000 40787d01 00000000 494d475f 30303031 2e435232 00000000"
)
JPEG_L_FINE_60D = bytes.fromhex("20000000 89c10000 20d10000 01000000 10000000 01000000 00000000 03000000")
"""As a 60D sent it."""


def record(code: int, payload: bytes) -> bytes:
    return struct.pack("<II", 8 + len(payload), code) + payload


def value_record(prop: int, number: int) -> bytes:
    return record(CanonEvent.PROP_VALUE_CHANGED, struct.pack("<II", prop, number))


def list_record(prop: int, numbers: list[int], form: int = 3) -> bytes:
    return record(
        CanonEvent.AVAIL_LIST_CHANGED, struct.pack(f"<III{len(numbers)}I", prop, form, len(numbers), *numbers)
    )


def added_record(handle: int, size: int, name: str, *, code: int = 0xC181, ofc: int = 0x3801) -> bytes:
    payload = struct.pack("<IIIIIII", handle, 0x00010001, ofc, 0, 0, size, 0x90000000)
    return record(code, payload + struct.pack("<I", handle) + name.encode().ljust(16, b"\0") + bytes(4))


def test_published_vectors_decode() -> None:
    stream = VALUE_60 + LIST_TWO + BUSY + WANTS_TRANSFER + END_OF_STREAM
    assert decode_events(stream) == (
        PropValue(0xD102, b"\x68\0\0\0"),
        AvailableValues(0xD102, numbers=(0x28, 0x38)),
        NumberRecord(0xC18B, 1),
        ObjectRecord(0xC186, 0x91900001, 0, 0xB103, 25_000_000, "IMG_0001.CR2"),
    )


def test_empty_poll_is_exactly_the_end_mark() -> None:
    assert decode_events(END_OF_STREAM) == ()


def test_property_write_vector() -> None:
    assert encode_property(0xD102, encode_number(0x68)) == bytes.fromhex("0c000000 02d10000 68000000")


def test_image_format_of_a_real_camera() -> None:
    (value,) = decode_events(JPEG_L_FINE_60D + END_OF_STREAM)
    assert isinstance(value, PropValue)
    assert value.number is None
    assert decode_image_format(value.raw) == (JPEG_LARGE_FINE,)
    assert encode_image_format((JPEG_LARGE_FINE,)) == value.raw
    assert encode_property(0xD120, value.raw) == bytes.fromhex(
        "1c000000 20d10000 01000000 10000000 01000000 00000000 03000000"
    )


def test_first_answer_of_a_60d_in_its_shape() -> None:
    """All values, then all lists in the same order, then the end: the list lengths are those of the log."""
    lengths = {0xD102: 55, 0xD103: 20, 0xD101: 17, 0xD106: 5, 0xD107: 4, 0xD108: 3, 0xD109: 9, 0xD10A: 76}
    shutters = sorted(SHUTTER_CODES)
    values = b"".join(value_record(p, 1) for p in (0xD105, 0xD108, *lengths))
    values += record(CanonEvent.PROP_VALUE_CHANGED, struct.pack("<I", CanonProp.OWNER) + b"someone\0")
    lists = b"".join(list_record(p, shutters if p == 0xD102 else list(range(n))) for p, n in lengths.items())
    lists += list_record(0xD11C, [2, 4, 6]) + list_record(0xD113, [], form=1)
    records = decode_events(values + lists + END_OF_STREAM)
    found = {r.prop: r.numbers for r in records if isinstance(r, AvailableValues)}
    assert {p: len(found[p]) for p in lengths} == lengths
    assert found[0xD11C] == (2, 4, 6)
    assert found[0xD113] == ()
    owner = next(r for r in records if isinstance(r, PropValue) and r.prop == CanonProp.OWNER)
    assert (owner.raw, owner.number) == (b"someone\0", None)


def test_added_object_and_unread_record() -> None:
    stream = added_record(0x91000005, 7_000_000, "IMG_0005.JPG") + record(0xC18E, b"") + END_OF_STREAM
    assert decode_events(stream) == (
        ObjectRecord(0xC181, 0x91000005, 0x00010001, 0x3801, 7_000_000, "IMG_0005.JPG"),
        OtherRecord(0xC18E, b""),
    )


def test_list_of_image_formats() -> None:
    formats = ((JPEG_LARGE_FINE,), (RAW_FULL, JPEG_LARGE_FINE), (ImageFile(6, 1, 4),))
    body = struct.pack("<III", 0xD120, 3, len(formats)) + b"".join(map(encode_image_format, formats))
    assert decode_events(record(0xC18A, body) + END_OF_STREAM) == (AvailableValues(0xD120, formats=formats),)


@pytest.mark.parametrize(
    "stream",
    [
        b"",
        VALUE_60,
        VALUE_60 + END_OF_STREAM[:-1],
        struct.pack("<II", 7, 0xC189) + END_OF_STREAM,
        struct.pack("<II", 0xFFFFFFFF, 0xC189) + END_OF_STREAM,
        struct.pack("<II", 0, 0),
        record(0xC189, b"\x02\xd1\0") + END_OF_STREAM,
        record(0xC18A, struct.pack("<III", 0xD102, 3, 0x40000000)) + END_OF_STREAM,
        record(0xC18A, struct.pack("<IIII", 0xD102, 3, 2, 0x28)) + END_OF_STREAM,
        record(0xC18A, struct.pack("<III", 0xD120, 3, 0xFFFFFFFF)) + END_OF_STREAM,
        record(0xC186, struct.pack("<5I", 1, 0x3801, 0, 9, 0) + b"IMG_0001.JPG") + END_OF_STREAM,
        END_OF_STREAM + VALUE_60,
    ],
    ids=[
        "nothing",
        "no end",
        "end cut",
        "size 7",
        "size huge",
        "size 0",
        "short value",
        "count huge",
        "list short",
        "formats huge",
        "name open",
        "after the end",
    ],
)
def test_malformed_streams_are_refused(stream: bytes) -> None:
    with pytest.raises(ProtocolViolationError):
        decode_events(stream)


@given(st.binary(max_size=400))
def test_any_bytes_decode_or_are_a_violation(data: bytes) -> None:
    for decode in (decode_events, decode_image_format):
        try:
            decode(data)
        except ProtocolViolationError:
            pass


codes = st.sampled_from([*map(int, CanonEvent), 0, 0xC1FF])


@given(st.lists(st.tuples(codes, st.binary(max_size=80)), max_size=8), st.integers(0, 700), st.integers(0, 255))
def test_damaged_streams_decode_or_are_a_violation(parts: list[tuple[int, bytes]], at: int, byte: int) -> None:
    stream = bytearray(b"".join(record(c, p) for c, p in parts if c or p) + END_OF_STREAM)
    stream[at % len(stream)] = byte
    try:
        records = decode_events(bytes(stream))
    except ProtocolViolationError:
        return
    assert len(records) <= len(stream) // 8


@given(st.lists(st.builds(ImageFile, *[st.integers(0, 2**32 - 1)] * 3), min_size=1, max_size=2))
def test_image_formats_round_trip(files: list[ImageFile]) -> None:
    assert decode_image_format(encode_image_format(files)) == tuple(files)


def test_every_third_stop_code_is_the_legal_one_nearest_to_the_formula() -> None:
    """38h + 8 log2(1/t), thirds at +3 and +5; nominal times are rounded (1/60 for 1/64)."""
    legal = [c for c in range(0x10, 0xA1) if c % 8 in (0, 3, 5)]
    for code, seconds in SHUTTER_CODES.items():
        exact = 0x38 + 8 * math.log2(1 / seconds)
        assert min(legal, key=lambda c: abs(c - exact)) == code, (hex(code), seconds)
    assert sorted(SHUTTER_CODES) == legal
    assert len(legal) == 55


def test_half_stop_codes_lie_between_full_stops() -> None:
    assert len(SHUTTER_CODES_HALF) == 14
    for code, seconds in SHUTTER_CODES_HALF.items():
        assert code % 8 == 4
        assert abs(code - (0x38 + 8 * math.log2(1 / seconds))) < 1.5


def test_codes_sorted_are_times_sorted_longest_first() -> None:
    for table in (SHUTTER_CODES, SHUTTER_CODES_HALF):
        times = [table[code] for code in sorted(table)]
        assert times == sorted(times, reverse=True)


@pytest.mark.parametrize("table", [SHUTTER_CODES, SHUTTER_CODES_HALF])
def test_every_shutter_code_round_trips(table: dict[int, float]) -> None:
    assert len(table) >= 14
    for code, seconds in table.items():
        assert nearest_time(seconds, table) == code


def test_paper_stops_have_exact_codes() -> None:
    for seconds, code in PAPER_STOPS.items():
        assert nearest_time(seconds, SHUTTER_CODES) == code


def test_nearest_is_by_stops_and_skips_what_is_no_time() -> None:
    available = [0x0C, 0x04, 0x28, 0x30, 0x60, 0xFFFF]
    assert shutter_codes_known(available) == (0x28, 0x30, 0x60)
    times_s = {code: SHUTTER_S[code] for code in shutter_codes_known(available)}
    assert nearest_time(2.9, times_s) == 0x28
    assert nearest_time(2.7, times_s) == 0x30
    assert nearest_time(1e-9, times_s) == 0x60
    for wrong in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="no shutter time"):
            nearest_time(wrong, times_s)
    with pytest.raises(ValueError, match="among 0"):
        nearest_time(1.0, {})


def test_iso_and_aperture_codes_round_trip() -> None:
    assert (len(ISO_CODES), len(APERTURE_CODES)) == (18, 20)
    for code, iso in ISO_CODES.items():
        assert (iso_code(iso), iso_text(code)) == (code, str(iso))
        assert abs(code - (0x48 + 8 * math.log2(iso / 100))) < 1
    for code, f_number in APERTURE_CODES.items():
        assert (aperture_code(f_number), aperture_text(code)) == (code, f"f/{f_number:g}")
        assert abs(code - (8 + 16 * math.log2(f_number))) < 1.5
    assert (iso_code(200), aperture_code(16)) == (0x50, 0x48)
    assert (iso_code(210), aperture_code(15)) == (None, None)
    assert (iso_text(0), aperture_text(0xB0)) == ("auto", "code 0xb0")


def test_words_for_what_the_camera_says() -> None:
    assert image_format_text((RAW_FULL, JPEG_LARGE_FINE)) == "JPEG L fine + RAW L"
    assert image_format_text((ImageFile(1, 2, 2),)) == "JPEG S normal"
    assert [release_problem(n) for n in (0, 1, 3)] == [None, "no focus", "the mirror is up"]
    assert release_problem(0x2005) == "release error 0x2005"
    assert release_problem(0x5005) is None


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="needs a settable time zone")
def test_camera_clock_is_read_as_utc_or_local_whichever_is_nearer(monkeypatch: pytest.MonkeyPatch) -> None:
    now = datetime(2023, 5, 19, 19, 54, tzinfo=UTC)
    with monkeypatch.context() as patch:
        patch.setenv("TZ", "EST4")
        time.tzset()
        counts_utc = camera_time_utc(int(now.timestamp()) + 7, now)
        counts_local = camera_time_utc(int(now.timestamp()) - 4 * 3600 + 7, now)
    time.tzset()
    assert counts_utc == counts_local == now + timedelta(seconds=7)
