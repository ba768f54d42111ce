"""EXIF read strictly: right values from an independent writer, a named problem for every lie."""

from __future__ import annotations

import random
import struct
from datetime import datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from benchmarks.shared_data import DATA
from station.frames.exif import parse_offset
from station.frames.exif import read_exif as read_tags
from station.frames.facts import ExifRecord
from station.frames.problems import FrameProblemError, Reason
from tests.station.frames.pictures import TAKEN, exif


def block(order: str, main: list[tuple], sub: list[tuple] | None = None, **places: int) -> bytes:
    """Build a TIFF block. Entries are (tag, type, count, value); bytes values longer than 4 go behind the tables.

    ``sub_at`` overrides the pointer to the Exif directory, ``main_at`` the one to the first.
    """
    mark = "<" if order == "little" else ">"
    main = list(main)
    n_main = len(main) + (sub is not None)
    sub_at = 8 + 2 + 12 * n_main + 4
    if sub is not None:
        main.append((0x8769, 4, 1, places.get("sub_at", sub_at)))
    tables = [sorted(main)] + ([sorted(sub)] if sub is not None else [])
    data_at = sub_at + (2 + 12 * len(sub) + 4 if sub is not None else 0)
    out = (b"II" if order == "little" else b"MM") + struct.pack(mark + "HI", 42, places.get("main_at", 8))
    extra = b""
    for table in tables:
        out += struct.pack(mark + "H", len(table))
        for tag, type_, count, value in table:
            if isinstance(value, int):
                packed = struct.pack(mark + ("H2x" if type_ == 3 else "I"), value)
            elif len(value) <= 4:
                packed = value.ljust(4, b"\0")
            else:
                packed = struct.pack(mark + "I", data_at + len(extra))
                extra += value
            out += struct.pack(mark + "HHI", tag, type_, count) + packed
        out += struct.pack(mark + "I", 0)
    return out + extra


def ratio(order: str, numerator: int, denominator: int) -> bytes:
    return struct.pack(("<" if order == "little" else ">") + "II", numerator, denominator)


def text(value: str) -> tuple[int, bytes]:
    raw = value.encode() + b"\0"
    return len(raw), raw


def usual(order: str = "little", **changes: tuple) -> list[tuple]:
    entries = {
        "time": (0x829A, 5, 1, ratio(order, 1, 60)),
        "f": (0x829D, 5, 1, ratio(order, 56, 10)),
        "iso": (0x8827, 3, 1, 100),
        "date": (0x9003, 2, *text("2023:05:19 15:54:10")),
        "sub": (0x9291, 2, *text("71")),
        "width": (0xA002, 4, 1, 6720),
        "height": (0xA003, 3, 1, 3360),
    }
    return [entry for entry in {**entries, **changes}.values() if entry]


def problem(data: bytes) -> str:
    with pytest.raises(FrameProblemError) as caught:
        read_exif(data)
    assert caught.value.reason is Reason.EXIF_DAMAGED
    return caught.value.message


def read_exif(data: bytes) -> ExifRecord:
    """Return the facts as the station takes them from the worker."""
    return ExifRecord.model_validate(read_tags(data))


def facts_or_none(data: bytes) -> ExifRecord | None:
    """Return the facts, or None where the one error that may be raised is."""
    try:
        return read_exif(data)
    except FrameProblemError:
        return None


@pytest.mark.parametrize("order", ["little", "big"])
def test_both_byte_orders(order):
    facts = read_exif(block(order, [(0x010F, 2, *text("RICOH")), (0x0112, 3, 1, 1)], usual(order)))
    assert facts == ExifRecord(
        exposure_s=1 / 60,
        f_number=5.6,
        iso=100,
        taken_local=datetime(2023, 5, 19, 15, 54, 10, 710_000),
        make="RICOH",
        orientation=1,
        width_px=6720,
        height_px=3360,
    )


@given(st.floats(1 / 8000, 60), st.integers(50, 25_600))
@settings(max_examples=50, deadline=None)
def test_reads_what_pillow_writes(time_s, iso):
    facts = read_exif(exif(time_s, ISO=iso, OFFSET="-04:00").tobytes()[6:])
    assert facts.exposure_s == pytest.approx(time_s, rel=1e-4)
    assert (facts.iso, facts.f_number, facts.taken_local, facts.offset_min) == (iso, 5.6, TAKEN, -240)
    assert (facts.make, facts.model, facts.serial) == ("Canon", "Canon EOS 5D Mark II", "0123456789")


def test_directories_out_of_range_or_in_a_loop():
    good = block("little", [], usual())
    assert read_exif(good).iso == 100
    assert "overlaps" in problem(block("little", [], usual(), sub_at=8))
    for place in (0, 7, len(good), len(good) - 1, 2**32 - 1):
        assert "directory" in problem(block("little", [], usual(), sub_at=place))
        assert "directory" in problem(block("little", [], usual(), main_at=place))


def test_counts_that_cannot_be():
    assert "65535 entries" in problem(b"II*\0\x08\0\0\0\xff\xff" + b"\0" * 60_000)
    assert "0 entries" in problem(b"II*\0\x08\0\0\0\0\0" + b"\0" * 10)
    for entry in (
        (0x829A, 5, 2**32 - 1, 8),  # a huge count of ratios
        (0x829A, 3, 1, 1),  # a time that is not a ratio
        (0x829A, 99, 1, 8),  # an unknown type
        (0x829A, 5, 1, 2**32 - 4),  # behind the end
        (0x829A, 5, 0, 8),
    ):
        assert "0x829a" in problem(block("little", [], usual(time=entry)))
    assert "0x9003" in problem(block("little", [], usual(date=(0x9003, 2, 60_000, 8))))


def test_values_that_cannot_be():
    order = "little"
    assert "1/0" in problem(block(order, [], usual(time=(0x829A, 5, 1, ratio(order, 1, 0)))))
    assert "4000 s" in problem(block(order, [], usual(time=(0x829A, 5, 1, ratio(order, 4000, 1)))))
    for written in ("2023:13:19 15:54:10", "9999:99:99 99:99:99", "yesterday"):
        assert "date" in problem(block(order, [], usual(date=(0x9003, 2, *text(written)))))
    for written in ("2023-05-19T15:54:10", "2023-05-19 15:54:10+02:00", "19/05/2023"):
        facts = read_exif(block(order, [], usual(date=(0x9003, 2, *text(written)))))
        assert (facts.taken_local, facts.exposure_s) == (None, 1 / 60), "another form of date costs no frame"
    assert "twice" in problem(block(order, [], [*usual(), (0x829A, 5, 1, ratio(order, 1, 30))]))


def test_unknown_values_say_nothing():
    order = "big"
    sub = usual(
        order,
        time=(0x829A, 5, 1, ratio(order, 0, 0)),
        f=(0x829D, 5, 1, ratio(order, 0, 1)),
        iso=(0x8827, 3, 1, 65535),
        date=(0x9003, 2, *text("0000:00:00 00:00:00")),
    )
    facts = read_exif(block(order, [], sub))
    assert (facts.exposure_s, facts.f_number, facts.iso, facts.taken_local) == (None, None, None, None)
    assert read_exif(block(order, [(0x010F, 2, *text("Canon"))])).make == "Canon"


@pytest.mark.parametrize("year", ["0001", "1969", "2101", "9999"])
def test_a_clock_of_an_odd_year_was_never_set(year):
    """Zones and offsets would lead such a date out of the calendar."""
    facts = read_exif(block("big", [], usual("big", date=(0x9003, 2, *text(f"{year}:01:01 00:00:00")))))
    assert facts.taken_local is None
    with pytest.raises(ValueError, match="taken_local"):
        ExifRecord(taken_local=datetime(int(year), 1, 1))


def test_maker_notes_thumbnails_and_gps_are_never_visited():
    hostile = [(0x927C, 7, 2**32 - 1, 2**32 - 1), (0xA005, 4, 1, 8)]
    main = [(0x8825, 4, 1, 8), (0x0201, 4, 1, 2**32 - 1)]
    assert read_exif(block("little", main, usual() + hostile)).exposure_s == 1 / 60


def test_text_is_made_printable():
    facts = read_exif(block("little", [(0x010F, 2, 9, b"Ca\x1b[2Jn\xff\0")]))
    assert facts.make == "Ca?[2Jn?"


@pytest.mark.parametrize("data", [b"", b"II", b"II*\0", b"XX*\0\x08\0\0\0" + b"\0" * 20, b"II+\0" + b"\0" * 30])
def test_no_tiff_header(data):
    assert "TIFF" in problem(data)


@pytest.mark.parametrize(
    ("said", "minutes"),
    [("+02:00", 120), ("-04:00", -240), ("+0530", 330), ("+15:00", None), ("", None), ("Z", None), ("+ab:cd", None)],
)
def test_zones(said, minutes):
    assert parse_offset(said) == minutes


def test_any_change_gives_facts_or_a_named_problem():
    changed = [facts_or_none(changed_block(seed)) for seed in range(1000)]
    found = [facts for facts in changed if facts is not None]
    assert 50 < len(found) < 500, "some changes leave sound facts, most are refused"
    assert all(facts.exposure_s is None or 0 < facts.exposure_s <= 3600 for facts in found)
    assert all(facts.make.isprintable() for facts in found)


def changed_block(seed):
    rng = random.Random(seed)
    data = bytearray(exif(0.25).tobytes()[6:])
    for _ in range(rng.randint(1, 8)):
        data[rng.randrange(len(data))] = rng.choice([0, 1, 8, 255, rng.randrange(256)])
    return bytes(data[: rng.randint(0, len(data))] if rng.random() < 0.2 else data)


@pytest.mark.shared("damaged/exif/libexif_testdata")
def test_real_maker_note_files_read_as_pillow_reads_them():
    files = sorted((DATA / "damaged" / "exif" / "libexif_testdata").glob("*.jpg"))
    assert files
    for path in files:
        data = path.read_bytes()
        at = data.index(b"Exif\0\0") + 6
        length = int.from_bytes(data[at - 8 : at - 6], "big") - 8
        facts = read_exif(data[at : at + length])
        theirs = Image.Exif()
        theirs.load(data[at - 6 : at + length])
        sub = theirs.get_ifd(0x8769)
        assert facts.make == str(theirs.get(0x010F, "")).strip("\0 ")
        assert facts.exposure_s == pytest.approx(sub.get(0x829A))
        assert facts.iso == sub.get(0x8827)
