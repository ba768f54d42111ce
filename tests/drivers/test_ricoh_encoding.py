"""The Theta's encodings against published vectors and the whole tables."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.camera import nearest_time
from drivers.theta_z1.codes import ERROR_INFO_BITS, SHUTTER_FRACTIONS
from drivers.theta_z1.settings import Fraction32, error_texts, f_number_code, f_number_codes

PAPER_STOPS = {
    4: (4, 1),
    1: (1, 1),
    1 / 4: (1, 4),
    1 / 15: (1, 15),
    1 / 60: (1, 60),
    1 / 250: (1, 250),
    1 / 1000: (1, 1000),
    1 / 4000: (1, 4000),
    1 / 8000: (1, 8000),
}
LEGAL = tuple(Fraction32(*pair) for pair in SHUTTER_FRACTIONS)
TIMES_S = {fraction: fraction.seconds for fraction in LEGAL}


@pytest.mark.parametrize(
    ("wire", "number", "seconds"),
    [
        ("01000000 a8610000", 0x000061A800000001, 1 / 25000),
        ("01000000 401f0000", 0x00001F4000000001, 1 / 8000),
        ("01000000 3c000000", 0x0000003C00000001, 1 / 60),
        ("0a000000 19000000", 0x000000190000000A, 1 / 2.5),
        ("0a000000 10000000", 0x000000100000000A, 1 / 1.6),
        ("20000000 0a000000", 0x0000000A00000020, 3.2),
        ("04000000 01000000", 0x0000000100000004, 4),
        ("3c000000 01000000", 0x000000010000003C, 60),
    ],
)
def test_published_shutter_vectors(wire: str, number: int, seconds: float) -> None:
    raw = bytes.fromhex(wire)
    assert number.to_bytes(8, "little") == raw, "LE32 numerator, LE32 denominator"
    fraction = Fraction32.from_u64(number)
    assert fraction.to_u64() == number
    assert fraction.seconds == pytest.approx(seconds)


def test_automatic_is_no_time() -> None:
    assert not Fraction32.from_u64(0).is_time


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_every_fraction_round_trips(numerator: int, denominator: int) -> None:
    fraction = Fraction32(numerator, denominator)
    assert Fraction32.from_u64(fraction.to_u64()) == fraction
    assert fraction.to_u64().to_bytes(8, "little") == struct.pack("<II", numerator, denominator)


def test_every_legal_time_is_its_own_nearest() -> None:
    assert len(LEGAL) == 61
    for fraction in LEGAL:
        assert nearest_time(fraction.seconds, TIMES_S) == fraction
    for seconds, pair in PAPER_STOPS.items():
        assert nearest_time(seconds, TIMES_S) == Fraction32(*pair)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_no_time_has_no_nearest(wrong: float) -> None:
    with pytest.raises(ValueError, match="no shutter time"):
        nearest_time(wrong, TIMES_S)


def test_f_number_encoding_is_decided_by_the_cameras_list() -> None:
    times_100, index = f_number_codes([0, 210, 350, 560]), f_number_codes([0, 1, 2, 3])
    assert times_100 is not None
    assert index is not None
    assert (f_number_code(5.6, times_100), f_number_code(2.1, times_100)) == (560, 210)
    assert (f_number_code(5.6, index), f_number_code(3.5, index)) == (3, 2)
    assert f_number_code(4.0, index) is None
    for neither in ([], [0], [0, 1, 2], [1, 2, 3, 4], [0, 56]):
        assert f_number_codes(neither) is None


def test_every_error_bit_is_named() -> None:
    assert len(ERROR_INFO_BITS) == 12
    for bit, (text, can_shoot) in ERROR_INFO_BITS.items():
        assert error_texts(bit) == (((), (text,)) if can_shoot else ((text,), ()))
    assert error_texts(0) == ((), ())
    assert error_texts(0x2 | 0x1) == (("no free memory",), ("unknown error bit 0x00000002",))
