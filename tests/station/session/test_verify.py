from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from station.errors import IntegrityError, JournalError, SessionLockedError, SessionNotFoundError
from station.session.manifest import load_manifest
from station.session.session import Side
from station.session.store import SessionStore
from station.session.verify import repair_session, verify_session
from tests.station.session.sessions import complete_session, manifest, put

FRAME = "indoor/01_1-4s.jpg"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return complete_session(tmp_path)


def edit(path: Path, **fields: object) -> None:
    data = json.loads((path / "session.json").read_bytes())
    (path / "session.json").write_text(json.dumps({**data, **fields}))


def edit_frame(path: Path, **fields: object) -> None:
    frames = json.loads((path / "session.json").read_bytes())["frames"]
    edit(path, frames=[{**f, **fields} if f["file"] == FRAME else f for f in frames])


def flip(file: Path, position: int) -> None:
    file.chmod(0o644)
    raw = bytearray(file.read_bytes())
    raw[position] ^= 1
    file.write_bytes(raw)


def replace_by(file: Path, make: Callable[[Path], None]) -> None:
    file.unlink()
    make(file)


def hard_link(path: Path) -> None:
    os.link(path / FRAME, path.parent / "elsewhere.jpg")


def links_out(path: Path) -> None:
    shutil.copy(path / FRAME, path.parent / "elsewhere.jpg")
    replace_by(path / FRAME, lambda f: f.symlink_to(path.parent / "elsewhere.jpg"))


def link_for_folder(path: Path) -> None:
    (path / "indoor").rename(path.parent / "moved")
    (path / "indoor").symlink_to(path.parent / "moved")


def swap_frames(path: Path) -> None:
    first, second = path / "indoor/00_4s.jpg", path / FRAME
    a, b = first.read_bytes(), second.read_bytes()
    for file, data in ((first, b), (second, a)):
        file.chmod(0o644)
        file.write_bytes(data)


DAMAGE: dict[str, tuple[Callable[[Path], object], set[tuple[str, str]]]] = {
    "flipped bit": (lambda p: flip(p / FRAME, 500), {("digest", FRAME)}),
    "shorter": (lambda p: os.truncate(p / FRAME, 10), {("size", FRAME)}),
    "missing": (lambda p: (p / FRAME).unlink(), {("missing", FRAME)}),
    "swapped": (swap_frames, {("size", FRAME), ("size", "indoor/00_4s.jpg")}),
    "extra": (lambda p: (p / "indoor/more.jpg").write_bytes(b"x"), {("extra", "indoor/more.jpg")}),
    "extra folder": (lambda p: (p / "indoor/more").mkdir(), {("irregular", "indoor/more")}),
    "symlink": (links_out, {("irregular", FRAME)}),
    "hard link": (hard_link, {("irregular", FRAME)}),
    "pipe": (lambda p: replace_by(p / FRAME, os.mkfifo), {("irregular", FRAME)}),
    "pipe in root": (lambda p: os.mkfifo(p / "pipe"), {("irregular", "pipe")}),
    "link in root": (lambda p: (p / "x").symlink_to("/etc"), {("irregular", "x")}),
    "link for a folder": (
        link_for_folder,
        {("irregular", "indoor")} | {("missing", f"indoor/{n}") for n in ("00_4s.jpg", "01_1-4s.jpg", "02_1-60s.jpg")},
    ),
    "folder gone": (
        lambda p: shutil.rmtree(p / "indoor"),
        {("missing", f"indoor/{n}") for n in ("00_4s.jpg", "01_1-4s.jpg", "02_1-60s.jpg")},
    ),
    "digest edited": (
        lambda p: edit_frame(p, sha256="0" * 64),
        {("digest", FRAME), ("manifest-behind", FRAME), ("not-journalled", FRAME)},
    ),
    "time edited": (lambda p: edit_frame(p, camera_s=0.5), {("manifest-behind", FRAME), ("not-journalled", FRAME)}),
    "heading edited": (lambda p: edit(p, heading_rad=1.0), {("manifest-differs", "session.json")}),
    "frames dropped": (
        lambda p: edit(p, frames=[]),
        {
            ("manifest-status", "session.json"),
            *(("manifest-behind", f"indoor/{n}") for n in ("00_4s.jpg", "01_1-4s.jpg", "02_1-60s.jpg")),
        },
    ),
    "not JSON": (lambda p: (p / "session.json").write_text("{"), {("manifest", "session.json")}),
    "no manifest": (lambda p: (p / "session.json").unlink(), {("manifest", "session.json")}),
    "newer": (lambda p: edit(p, schema_version=2), {("manifest", "session.json")}),
    "journal damaged": (lambda p: flip(p / "journal.jsonl", 40), {("journal", "journal.jsonl")}),
    "journal torn": (
        lambda p: os.truncate(p / "journal.jsonl", (p / "journal.jsonl").stat().st_size - 1),
        {("journal-torn", "journal.jsonl")},
    ),
    "journal a pipe": (lambda p: replace_by(p / "journal.jsonl", os.mkfifo), {("journal", "journal.jsonl")}),
}


def test_an_intact_session(path: Path) -> None:
    report = verify_session(path)
    assert report.to_dict() == {
        "intact": True,
        "path": str(path),
        "fast": False,
        "status": "complete",
        "missing": (),
        "frames_checked": 3,
        "frames_safe": 3,
        "frames_planned": 3,
        "imported": False,
        "bytes_read": 3003,
        "problems": [],
        "notes": [],
    }
    report.raise_for_problems()
    assert json.loads(json.dumps(report.to_dict()))["intact"]


@pytest.mark.parametrize("name", DAMAGE)
def test_every_damage_is_named(path: Path, name: str) -> None:
    make, expected = DAMAGE[name]
    make(path)
    report = verify_session(path)
    assert {(p.code, p.file) for p in report.problems} == expected
    with pytest.raises(
        IntegrityError, match=rf"{len(report.problems)} problem{'' if len(report.problems) == 1 else 's'}:"
    ):
        report.raise_for_problems()


def test_without_a_manifest_the_journal_still_lists_the_frames(path: Path) -> None:
    (path / "session.json").unlink()
    flip(path / FRAME, 1)
    assert [(p.code, p.file) for p in verify_session(path).problems] == [
        ("manifest", "session.json"),
        ("digest", FRAME),
    ]


def test_all_problems_are_listed_at_once(path: Path) -> None:
    flip(path / FRAME, 1)
    (path / "indoor/00_4s.jpg").unlink()
    (path / "outdoor/more.jpg").write_bytes(b"x")
    codes = [p.code for p in verify_session(path).problems]
    assert sorted(codes) == ["digest", "extra", "missing"]


def test_fast_reads_no_frame(path: Path) -> None:
    flip(path / FRAME, 500)
    report = verify_session(path, fast=True)
    assert report.intact
    assert report.bytes_read == 0
    os.truncate(path / "indoor/00_4s.jpg", 1)
    assert [p.code for p in verify_session(path, fast=True).problems] == ["size"]


def test_a_check_of_the_content_can_be_added(path: Path) -> None:
    seen = []

    def check(file: Path, frame: object) -> str | None:
        seen.append(file.name)
        return "is no JPEG" if file.name.startswith("01") else None

    report = verify_session(path, frame_check=check)
    assert len(seen) == 3
    assert [(p.code, p.file, p.message) for p in report.problems] == [("content", FRAME, "is no JPEG")]


def test_results_and_leftovers_are_no_problem(path: Path) -> None:
    (path / "stages" / "merge").mkdir(parents=True)
    (path / "report").mkdir()
    (path / "indoor" / ".part-1234-x.jpg").write_bytes(b"x")
    report = verify_session(path)
    assert report.intact
    assert len(report.notes) == 1


@pytest.mark.parametrize("name", [".DS_Store", "._00_4s.jpg", "Thumbs.db", "desktop.ini"])
def test_what_a_file_browser_leaves_is_no_problem(path: Path, name: str) -> None:
    (path / "indoor" / name).write_bytes(b"x")
    report = verify_session(path)
    assert report.intact
    assert any(name in note for note in report.notes)
    (path / "indoor" / f"{name}.jpg").write_bytes(b"x")
    assert verify_session(path).intact is name.startswith("._")


def test_a_session_without_a_journal_is_vouched_for_by_its_manifest(path: Path) -> None:
    (path / "journal.jsonl").unlink()
    report = verify_session(path)
    assert report.intact
    assert report.notes == ["no journal: the manifest alone vouches for the files"]


def test_a_partial_session_is_intact_and_partial(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        put(store, 0, b"a")
        store.finish()
    report = verify_session(store.path)
    assert report.intact
    assert report.status == "partial"
    assert len(report.missing) == 2


def test_no_session(tmp_path: Path) -> None:
    for nowhere in (tmp_path, tmp_path / "none", tmp_path / "file"):
        (tmp_path / "file").touch()
        with pytest.raises(SessionNotFoundError):
            verify_session(nowhere)


def test_nothing_changes_on_a_read_only_folder(path: Path) -> None:
    """Run by a user who may not write: root may write anywhere, so modes alone prove nothing."""
    if os.geteuid() == 0:
        before = {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in (path, *path.rglob("*"))}
        assert verify_session(path).intact
        assert {p: (p.stat().st_mtime_ns, p.stat().st_size) for p in (path, *path.rglob("*"))} == before
        return
    for folder in (path / "indoor", path / "outdoor", path / "rejected", path):
        folder.chmod(0o555)
    assert verify_session(path).intact
    for folder in (path, path / "indoor", path / "outdoor", path / "rejected"):
        folder.chmod(0o755)


def test_repair_brings_the_manifest_back_and_keeps_the_damaged_one(path: Path) -> None:
    expected = load_manifest(path)
    (path / "session.json").write_bytes(b"\0" * 100)
    assert repair_session(path).intact
    assert load_manifest(path) == expected
    assert (path / "rejected" / "damaged-session.json").read_bytes() == b"\0" * 100


def test_repair_catches_up_after_a_crash_and_deletes_nothing(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        put(store, 0, b"a")
        half = store.begin_frame(Side.INDOOR, 1, 1 / 4)
        half.write(b"half")
        left = {p for p in store.path.rglob("*") if p.is_file()}
    assert [p.code for p in verify_session(store.path).problems] == ["manifest-behind"]
    assert repair_session(store.path).intact
    assert {p for p in store.path.rglob("*") if p.is_file()} == left


def test_repair_refuses_what_it_cannot_know(path: Path) -> None:
    with SessionStore.open(path, writable=True), pytest.raises(SessionLockedError):
        repair_session(path)
    (path / "journal.jsonl").unlink()
    with pytest.raises(JournalError, match="no journal"):
        repair_session(path)


def test_repair_does_not_hide_a_damaged_frame(path: Path) -> None:
    flip(path / FRAME, 3)
    assert [p.code for p in repair_session(path).problems] == ["digest"]


def test_no_terminal_codes_from_file_names(path: Path) -> None:
    (path / "indoor" / "\x1b[2Jx").write_bytes(b"")
    (path / "indoor" / os.fsdecode(b"\xff")).write_bytes(b"")
    report = verify_session(path)
    assert [p.file for p in report.problems] == ["indoor/\\x1b[2Jx", "indoor/\\udcff"]


@settings(max_examples=60, deadline=None)
@given(which=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_a_flipped_bit_anywhere_is_noticed(tmp_path_factory: pytest.TempPathFactory, which: int, bit: int) -> None:
    """One bit of any frame, of the manifest or of the journal: never silently another session."""
    path = complete_session(tmp_path_factory.mktemp("s"))
    whole = load_manifest(path)
    files = [path / f.file for f in whole.frames] + [path / "session.json", path / "journal.jsonl"]
    sizes = [f.stat().st_size for f in files]
    position = which % sum(sizes)
    for file, size in zip(files, sizes, strict=True):
        if position < size:
            file.chmod(0o644)
            raw = bytearray(file.read_bytes())
            raw[position] ^= 1 << bit
            file.write_bytes(raw)
            break
        position -= size
    report = verify_session(path)
    if report.intact:  # white space in session.json, or another spelling of the same value
        assert load_manifest(path) == whole
        assert file.name == "session.json"


def test_verify_runs_where_only_the_store_is_imported() -> None:
    heavy = "{'mocks', 'cv2', 'usb'}"
    code = f"import sys, station.session.verify; sys.exit(any(m.split('.')[0] in {heavy} for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
