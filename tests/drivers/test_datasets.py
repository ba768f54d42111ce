from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ProtocolViolationError
from drivers.ptp import datasets
from drivers.ptp.codes import DataType, FormFlag
from drivers.ptp.datasets import DeviceInfo, DevicePropDesc, ObjectInfo, StorageInfo
from tests.drivers import encoders

u16, u32, u64 = (st.integers(0, 2**bits - 1) for bits in (16, 32, 64))
texts = st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=120)
codes = st.lists(u16, max_size=40).map(tuple)

INTEGER_TYPES = [*range(0x0001, 0x000B)]


def integers(data_type: int) -> st.SearchStrategy[int]:
    bits = 8 << (data_type - 1) // 2
    return st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if data_type % 2 else st.integers(0, 2**bits - 1)


def values_of(data_type: int) -> st.SearchStrategy[Any]:
    if data_type == DataType.STRING:
        return texts
    if data_type & DataType.ARRAY:
        return st.lists(integers(data_type & ~DataType.ARRAY), max_size=20).map(tuple)
    return integers(data_type)


data_types = st.sampled_from([*INTEGER_TYPES, *(0x4000 | t for t in INTEGER_TYPES), DataType.STRING])

device_infos = st.builds(
    DeviceInfo, u16, u32, u16, texts, u16, codes, codes, codes, codes, codes, texts, texts, texts, texts
)
storage_infos = st.builds(StorageInfo, u16, u16, u16, u64, u64, u32, texts, texts)
object_infos = st.builds(
    ObjectInfo, u32, u16, u16, u32, u16, u32, u32, u32, u32, u32, u32, u32, u16, u32, u32, texts, texts, texts, texts
)


@st.composite
def prop_descs(draw: st.DrawFn) -> DevicePropDesc:
    data_type = draw(data_types)
    value = values_of(data_type)
    form = draw(st.sampled_from(FormFlag))
    value_range = draw(st.tuples(value, value, value)) if form is FormFlag.RANGE else None
    choices = draw(st.lists(value, max_size=6).map(tuple)) if form is FormFlag.ENUMERATION else ()
    return DevicePropDesc(
        draw(u16), data_type, draw(st.booleans()), draw(value), draw(value), form, value_range, choices
    )


PAIRS: dict[str, tuple[st.SearchStrategy[Any], Callable[[Any], bytes], Callable[[bytes], Any]]] = {
    "DeviceInfo": (device_infos, encoders.encode_device_info, datasets.decode_device_info),
    "StorageInfo": (storage_infos, encoders.encode_storage_info, datasets.decode_storage_info),
    "ObjectInfo": (object_infos, encoders.encode_object_info, datasets.decode_object_info),
    "DevicePropDesc": (prop_descs(), encoders.encode_device_prop_desc, datasets.decode_device_prop_desc),
}


EXTENSIBLE = {"DeviceInfo", "StorageInfo", "ObjectInfo"}
"""Devices append fields of their own; the virtual camera of libgphoto2 appends a string to DeviceInfo."""


@pytest.mark.parametrize("name", PAIRS)
@given(data=st.data())
def test_decode_undoes_encode_and_nothing_else_passes(name: str, data: st.DataObject) -> None:
    strategy, encode, decode = PAIRS[name]
    dataset = data.draw(strategy)
    wire = encode(dataset)
    assert decode(wire) == dataset
    cut = data.draw(st.integers(0, len(wire) - 1))
    with pytest.raises(ProtocolViolationError):
        decode(wire[:cut])
    if name in EXTENSIBLE:
        assert decode(wire + b"\0\1\2") == dataset
    else:
        with pytest.raises(ProtocolViolationError, match="3 bytes too many"):
            decode(wire + b"\0\1\2")


@pytest.mark.parametrize("name", PAIRS)
@given(data=st.data())
def test_any_bytes_decode_or_are_a_violation(name: str, data: st.DataObject) -> None:
    strategy, encode, decode = PAIRS[name]
    wire = bytearray(data.draw(st.one_of(st.binary(max_size=200), strategy.map(encode))))
    for at in data.draw(st.lists(st.integers(0, max(0, len(wire) - 1)), max_size=4)):
        if wire:
            wire[at] = data.draw(st.integers(0, 255))
    try:
        dataset = decode(bytes(wire))
    except ProtocolViolationError:
        return
    assert decode(encode(dataset)) == dataset


@given(st.data())
def test_values_both_ways(data: st.DataObject) -> None:
    data_type = data.draw(data_types)
    value = data.draw(values_of(data_type))
    wire = datasets.encode_value(value, data_type)
    assert datasets.decode_value(wire, data_type) == value
    with pytest.raises(ProtocolViolationError):
        datasets.decode_value(wire[:-1], data_type)


@given(st.binary(max_size=80), u16)
def test_any_bytes_of_any_type_are_a_value_or_a_violation(wire: bytes, data_type: int) -> None:
    try:
        value = datasets.decode_value(wire, data_type)
    except ProtocolViolationError:
        return
    assert datasets.decode_value(datasets.encode_value(value, data_type), data_type) == value


@pytest.mark.parametrize("data_type", [0x4001, 0x4002, 0x400A])
def test_false_counts_allocate_nothing(data_type: int) -> None:
    tracemalloc.start()
    with pytest.raises(ProtocolViolationError, match="announces 4294967295 items"):
        datasets.decode_value(b"\xff\xff\xff\xff" + bytes(16), data_type)
    desc = bytes.fromhex("0350 0400 01 0000 0000 02 ffff") + bytes(10)
    with pytest.raises(ProtocolViolationError):
        datasets.decode_device_prop_desc(desc)
    assert tracemalloc.get_traced_memory()[1] < 64 * 1024
    tracemalloc.stop()


# By hand, from the layouts of devices.md 4.3 and 4.4.


@pytest.mark.parametrize(
    ("text", "wire"),
    [("", "00"), ("A", "02 4100 0000"), ("\N{GRINNING FACE}", "03 3dd8 00de 0000")],
)
def test_strings_by_hand(text: str, wire: str) -> None:
    assert datasets.encode_string(text) == bytes.fromhex(wire)
    assert datasets.decode_value(bytes.fromhex(wire), DataType.STRING) == text


@pytest.mark.parametrize(
    "wire",
    [
        pytest.param("02 4100 4200", id="not closed"),
        pytest.param("04 4100 0000 4200 0000", id="text after NUL"),
        pytest.param("02 3dd8 0000", id="lone surrogate"),
        pytest.param("03 4100 0000", id="shorter than it says"),
        pytest.param("", id="empty"),
    ],
)
def test_strings_that_are_none(wire: str) -> None:
    with pytest.raises(ProtocolViolationError):
        datasets.decode_value(bytes.fromhex(wire), DataType.STRING)


def test_string_padded_with_nul_and_string_of_one_nul() -> None:
    assert datasets.decode_value(bytes.fromhex("04 4100 0000 0000 0000"), DataType.STRING) == "A"
    assert datasets.decode_value(bytes.fromhex("01 0000"), DataType.STRING) == ""


@pytest.mark.parametrize("text", ["x" * 255, "a\0b", "\ud800"])
def test_strings_that_ptp_cannot_carry(text: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - UnicodeEncodeError or our own
        datasets.encode_string(text)


def test_theta_shutter_speed_is_numerator_then_denominator() -> None:
    assert datasets.encode_value(0x0000003C00000001, DataType.UINT64) == bytes.fromhex("01000000 3c000000")


def test_theta_f_number_desc_by_hand() -> None:
    wire = bytes.fromhex("0750 0400 01 0000 3002 02 0400 0000 d200 5e01 3002")
    desc = datasets.decode_device_prop_desc(wire)
    assert desc == DevicePropDesc(0x5007, 4, True, 0, 560, FormFlag.ENUMERATION, None, (0, 210, 350, 560))
    assert encoders.encode_device_prop_desc(desc) == wire


def test_object_info_by_hand() -> None:
    wire = bytes.fromhex(
        "01000200 0138 0000 40787d01 0838 00100000 a0000000 78000000 401a0000 200d0000 18000000"
        "05000000 0000 00000000 07000000"
    )
    name, date = "R0010001.JPG", "20230519T155400+0200"
    wire += datasets.encode_string(name) + datasets.encode_string(date) + b"\0\0"
    info = datasets.decode_object_info(wire)
    assert (info.storage_id, info.format_code, info.size_bytes) == (0x00020001, 0x3801, 25_000_000)
    assert (info.image_width_px, info.image_height_px, info.parent, info.filename) == (6720, 3360, 5, name)
    assert datasets.decode_date(info.capture_date) == datetime(2023, 5, 19, 15, 54, tzinfo=timezone(timedelta(hours=2)))


def test_storage_info_of_the_theta_by_hand() -> None:
    wire = bytes.fromhex("0300 0300 0000") + (21055815680).to_bytes(8, "little") + bytes(8) + b"\xff" * 4 + b"\0\0"
    info = datasets.decode_storage_info(wire)
    assert (info.storage_type, info.filesystem_type, info.access, info.max_bytes) == (3, 3, 0, 21055815680)
    assert info.description == ""


@pytest.mark.parametrize(
    ("field", "wire"),
    [
        ("access", "0350 0400 02 0000 0000 00"),
        ("form", "0350 0400 01 0000 0000 07"),
        ("datatype", "0350 0b00 01 0000 0000 00"),
    ],
)
def test_prop_descs_that_are_none(field: str, wire: str) -> None:
    with pytest.raises(ProtocolViolationError, match=field):
        datasets.decode_device_prop_desc(bytes.fromhex(wire))


@pytest.mark.parametrize(
    ("value", "data_type"),
    [
        (256, 0x0002),
        (-1, 0x0004),
        ("x", 0x0004),
        (1, 0xFFFF),
        ((1,), 0x0004),
        (1, 0x4004),
        (1, 0x0000),
        ((300,), 0x4002),
    ],
)
def test_values_that_do_not_fit(value: datasets.Value, data_type: int) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        datasets.encode_value(value, data_type)


def test_descs_that_contradict_themselves() -> None:
    with pytest.raises(ValueError, match="range"):
        encoders.encode_device_prop_desc(DevicePropDesc(1, 4, True, 0, 0, FormFlag.RANGE))
    with pytest.raises(ValueError, match="choices"):
        encoders.encode_device_prop_desc(DevicePropDesc(1, 4, True, 0, 0, FormFlag.NONE, None, (1,)))


@pytest.mark.parametrize(
    ("text", "date"),
    [
        ("20230519T155400", datetime(2023, 5, 19, 15, 54)),
        ("20230519T155400.5", datetime(2023, 5, 19, 15, 54, 0, 500_000)),
        ("20230519T155400Z", datetime(2023, 5, 19, 15, 54, tzinfo=UTC)),
        ("20230519T155400.0-0330", datetime(2023, 5, 19, 15, 54, tzinfo=timezone(-timedelta(hours=3, minutes=30)))),
    ],
)
def test_dates(text: str, date: datetime) -> None:
    assert datasets.decode_date(text) == date
    assert datasets.decode_date("") is None


@given(st.datetimes(datetime(1900, 1, 1)), st.none() | st.integers(-14 * 60, 14 * 60))
def test_dates_both_ways(moment: datetime, offset_min: int | None) -> None:
    zone = None if offset_min is None else timezone(timedelta(minutes=offset_min))
    date = moment.replace(microsecond=0, tzinfo=zone)
    assert datasets.decode_date(encoders.encode_date(date)) == date


@given(st.text(max_size=30) | st.from_regex(r"\d{8}T\d{6}(\.\d{1,3})?([+-]\d{4}|Z)?", fullmatch=True))
def test_any_text_is_a_date_or_a_violation(text: str) -> None:
    try:
        datasets.decode_date(text)
    except ProtocolViolationError:
        pass


@pytest.mark.parametrize("text", ["20230230T000000", "20230519T250000", "2023-05-19", "20230519T155400+9999"])
def test_dates_that_do_not_exist(text: str) -> None:
    with pytest.raises(ProtocolViolationError):
        datasets.decode_date(text)
