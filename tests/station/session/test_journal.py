from __future__ import annotations

import os
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.clock import SystemClock
from station.errors import DiskError, JournalError
from station.session import durable
from station.session.folder import Folder
from station.session.journal import Journal, JournalEntry, decode_line, encode_line, parse_journal, read_journal
from station.session.session import Side
from station.session.store import SessionStore
from tests.station.session.sessions import manifest, put

JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**15), 10**15)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(exclude_categories=["Cs"]), max_size=30),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text('abcé\n"\\', max_size=6), inner, max_size=4),
    max_leaves=10,
)
DATA = st.dictionaries(st.text("abcdef", max_size=8), JSON, max_size=5)


def lines(count: int) -> list[bytes]:
    return [
        encode_line(JournalEntry(n, "2023-05-19T15:54:00+00:00", n / 7, "note", {"n": n})) for n in range(1, count + 1)
    ]


@given(seq=st.integers(1, 10**9), monotonic_s=st.floats(0, 1e9), kind=st.text("abc_", max_size=20), data=DATA)
def test_a_line_says_again_what_was_written(seq: int, monotonic_s: float, kind: str, data: dict[str, Any]) -> None:
    entry = JournalEntry(seq, "2023-05-19T15:54:00+00:00", monotonic_s, kind, data)
    line = encode_line(entry)
    assert line.count(b"\n") == 1
    assert decode_line(line[:-1]) == entry


@given(cut=st.integers(0, 10_000))
def test_a_cut_leaves_the_whole_lines(cut: int) -> None:
    whole = lines(5)
    raw = b"".join(whole)
    cut %= len(raw) + 1
    content = parse_journal(raw[:cut], "journal.jsonl")
    kept = next(n for n in range(5, -1, -1) if len(b"".join(whole[:n])) <= cut)
    assert len(content.entries) == kept
    assert content.good_bytes == len(b"".join(whole[:kept]))
    assert content.torn == raw[content.good_bytes : cut]


@given(position=st.integers(0, 10_000), bit=st.integers(0, 7))
def test_every_flipped_bit_is_noticed(position: int, bit: int) -> None:
    whole = lines(4)
    raw = bytearray(b"".join(whole))
    raw[position % len(raw)] ^= 1 << bit
    last = len(raw) - len(whole[-1])
    if position % len(raw) < last - 1:
        with pytest.raises(JournalError, match=r"line \d"):
            parse_journal(bytes(raw), "journal.jsonl")
    else:
        try:
            content = parse_journal(bytes(raw), "journal.jsonl")
        except JournalError:
            return  # the newline before the last line, or one made within it
        assert content.torn
        assert len(content.entries) < 4


def test_lines_that_are_missing_swapped_or_twice_are_noticed() -> None:
    one, two, three, four = lines(4)
    for wrong in ([one, three, four], [two, three], [one, three, two, four], [one, two, two, three]):
        with pytest.raises(JournalError, match="in place of"):
            parse_journal(b"".join(wrong), "journal.jsonl")


@pytest.mark.parametrize(
    "body",
    [
        b'{"seq":1}',
        b'{"seq":"1","utc":"","monotonic_s":0.0,"kind":"x","data":{}}',
        b'{"seq":1,"utc":"","monotonic_s":0.0,"kind":"x","data":[]}',
        b'{"seq":1,"utc":"","monotonic_s":NaN,"kind":"x","data":{}}',
        b'{"seq":1,"utc":"","monotonic_s":0.0,"kind":"x","data":{},"more":1}',
        b"[]",
        b'{"seq":1,"utc":"","monotonic_s":0.0,"kind":"x","data":' + b"[" * 100_000 + b"}",
    ],
)
def test_a_line_of_another_form_is_refused_with_a_right_checksum_too(body: bytes) -> None:
    with pytest.raises(ValueError):  # noqa: PT011
        decode_line(b"%08d %08x %s" % (len(body), zlib.crc32(body), body))


@pytest.mark.parametrize("tail", [b"\0" * 4096, b"\0" * 50 + b"\n", b"garbage", b"00000010 ", b"\xff" * 40])
def test_zeros_and_rubbish_at_the_end_are_a_torn_line(tail: bytes) -> None:
    raw = b"".join(lines(3))
    content = parse_journal(raw + tail, "journal.jsonl")
    assert (len(content.entries), content.torn) == (3, tail)


def test_a_torn_end_is_cut_and_the_journal_goes_on(tmp_path: Path) -> None:
    raw = b"".join(lines(3))
    (tmp_path / "journal.jsonl").write_bytes(raw + b"00000100 torn")
    folder = Folder.open(tmp_path)
    journal = Journal(folder, SystemClock(), read_journal(folder))
    assert (tmp_path / "journal.jsonl").read_bytes() == raw
    journal.append("after", {})
    journal.close()
    content = read_journal(folder)
    assert content is not None
    assert [e.kind for e in content.entries] == ["note"] * 3 + ["after"]
    folder.close()


def test_a_line_that_failed_does_not_count_and_the_next_one_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Folder.open(tmp_path)
    journal = Journal(folder, SystemClock(), None)
    journal.append("first", {})
    inode = (tmp_path / "journal.jsonl").stat().st_ino

    def failing(fd: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(durable.os_calls, "fdatasync", failing)
        with pytest.raises(DiskError, match=r"journal\.jsonl"):
            journal.append("lost", {})
    journal.append("second", {})
    journal.close()
    content = read_journal(folder)
    folder.close()
    assert content is not None
    assert [(e.seq, e.kind) for e in content.entries] == [(1, "first"), (2, "second")]
    assert (tmp_path / "journal.jsonl").stat().st_ino != inode


def test_numbers_that_json_lacks_are_not_written() -> None:
    entry = JournalEntry(1, "", 0.0, "x", {"bad": float("nan")})
    with pytest.raises(ValueError, match="JSON"):
        encode_line(entry)
    encode_line(replace(entry, data={"path": Path("odd")}))


@pytest.fixture(scope="module")
def session() -> Iterator[tuple[Path, list[int]]]:
    """A session that was never finished, and the length of its journal after each acknowledged frame."""
    ends = []
    memory = Path("/dev/shm")
    parent = Path(tempfile.mkdtemp(prefix="daylit-", dir=memory if memory.is_dir() else None))
    with SessionStore.create(parent, manifest()) as store:
        for stop in range(3):
            put(store, stop, bytes([stop]) * 100)
            ends.append((store.path / "journal.jsonl").stat().st_size)
    yield store.path, ends
    shutil.rmtree(parent)


@settings(max_examples=150, deadline=None)
@given(cut=st.integers(0, 5000))
def test_a_journal_cut_at_any_byte_keeps_what_was_acknowledged(session: tuple[Path, list[int]], cut: int) -> None:
    path, ends = session
    cut %= ends[-1] + 1
    copy = path.parent / f"copy-{os.getpid()}"
    shutil.copytree(path, copy)
    try:
        with (copy / "journal.jsonl").open("r+b") as file:
            file.truncate(cut)
        with SessionStore.open(copy, writable=True) as store:
            frames = store.manifest.frames
            assert [f.stop for f in frames] == [s for s in range(3) if ends[s] <= cut]
            kept = {f.file for f in frames} | {r.file for r in store.manifest.rejected}
            assert len(kept) == 3  # what is not acknowledged is set aside, not lost
            assert store.manifest.missing_stops(Side.INDOOR) == tuple(s for s in range(3) if ends[s] > cut)
    finally:
        shutil.rmtree(copy)
