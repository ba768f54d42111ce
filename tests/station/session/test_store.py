from __future__ import annotations

import multiprocessing
import multiprocessing.synchronize
import os
import stat
import threading
from pathlib import Path

import pytest

from station.errors import (
    FrameRejectedError,
    IntegrityError,
    JournalError,
    ManifestError,
    SessionError,
    SessionLockedError,
    SessionNotFoundError,
)
from station.session import folder as folder_module
from station.session import folder as session_folder
from station.session.folder import frame_name
from station.session.session import (
    DeviceRecord,
    ReadingRecord,
    RejectedFrame,
    SessionStatus,
    Side,
    SkippedStop,
    WarningRecord,
)
from station.session.store import Recovery, SessionStore, load_manifest
from tests.station.session.sessions import CREATED_UTC, STOPS_S, complete_session, frame_record, manifest, put


@pytest.mark.parametrize(
    ("stop", "asked_s", "format_", "name"),
    [
        (0, 4.0, "jpeg", "00_4s.jpg"),
        (4, 1 / 60, "jpeg", "04_1-60s.jpg"),
        (8, 1 / 8000, "cr2", "08_1-8000s.cr2"),
        (1, 1.0, "dng", "01_1s.dng"),
        (2, 2.5, "jpeg", "02_2.5s.jpg"),
        (3, 0.3, "jpeg", "03_0.3s.jpg"),
        (3, 0.4, "jpeg", "03_0.4s.jpg"),
    ],
)
def test_file_names_come_from_side_stop_and_time(stop: int, asked_s: float, format_: str, name: str) -> None:
    assert frame_name(stop, asked_s, format_) == name


def test_a_new_session_has_its_manifest_and_journal_at_once(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path / "not" / "yet", manifest()) as store:
        assert store.path.name == "2023-05-19T1554Z_coda-320"
        assert load_manifest(store.path).session_id == "ab" * 16
        assert (store.path / "journal.jsonl").stat().st_size > 0


def test_namesakes_get_numbers(tmp_path: Path) -> None:
    for suffix in ("", "-2", "-3"):
        with SessionStore.create(tmp_path, manifest()) as store:
            assert store.path.name == "2023-05-19T1554Z_coda-320" + suffix


def test_a_frame_is_on_disk_read_only_and_in_the_manifest(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        record = put(store, 2, b"pixels" * 100)
        file = store.path / record.file
        assert file.read_bytes() == b"pixels" * 100
        assert stat.S_IMODE(file.stat().st_mode) == 0o444
        assert store.manifest.frames == (record,)
        assert [p.name for p in file.parent.iterdir()] == ["02_1-60s.jpg"]


def test_the_part_can_be_looked_at_before_the_commit(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.OUTDOOR, 0, 4.0)
        part.write(b"half")
        part.write(b"half")
        assert part.path.read_bytes() == b"halfhalf"
        assert part.path.parent == store.path / "outdoor"
        part.abort()
        part.abort()
        assert not part.path.exists()


def test_a_frame_beyond_the_cap_is_refused_before_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_folder, "FRAME_CAP_BYTES", 10)
    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"0123456789")
        with pytest.raises(FrameRejectedError):
            part.write(b"x")
        assert part.size_bytes == part.path.stat().st_size == 10
        part.abort()


def test_a_rejected_frame_is_kept_aside(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        for number in ("", "-2"):
            part = store.begin_frame(Side.INDOOR, 1, 1 / 4)
            part.write(b"black")
            file = part.reject("black")
            assert file == f"rejected/indoor_01_1-4s{number}.jpg"
            store.add(RejectedFrame(side=Side.INDOOR, stop=1, file=file, reason="black"))
            assert (store.path / file).read_bytes() == b"black"
        assert store.manifest.missing_stops(Side.INDOOR) == (0, 1, 2)
        assert len(store.manifest.rejected) == 2


def test_everything_is_there_again_without_a_saved_manifest(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest(readings_planned=2)) as store:
        put(store, 0, b"a")
        put(store, 1, b"b")
        store.add(SkippedStop(side=Side.INDOOR, stop=2, reason="dark"))
        for when in ("before", "after"):
            store.add(
                ReadingRecord(when=when, status="ok", luminance_cd_m2=34.63, taken_utc=CREATED_UTC)  # type: ignore[arg-type]
            )
        store.add(WarningRecord(code="drift", message="clouds"))
        store.update(drift_frac=0.01, devices=(DeviceRecord(role="meter", kind="ls160"),))
        store.event("paused", why="door opened")
        before = store.manifest
    with SessionStore.open(store.path, writable=True) as again:
        assert again.manifest == before
        assert again.recovery == Recovery()
    assert before.status is SessionStatus.COMPLETE
    assert load_manifest(store.path).frames == ()


def test_finish_says_what_is_missing(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        put(store, 0, b"a")
        final = store.finish()
    assert final.status is SessionStatus.PARTIAL
    assert final.missing == ("indoor: stop 1 (1/4 s)", "indoor: stop 2 (1/60 s)")
    assert load_manifest(store.path) == final


def test_a_committed_frame_without_acknowledgement_is_set_aside(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"orphan")
        part.commit()
        half = store.begin_frame(Side.INDOOR, 1, 1 / 4)
        half.write(b"half")
    with SessionStore.open(store.path, writable=True) as again:
        assert again.recovery.set_aside == ("rejected/indoor_00_4s.jpg",)
        assert len(again.recovery.swept) == 1
        assert (store.path / "rejected/indoor_00_4s.jpg").read_bytes() == b"orphan"
        assert again.manifest.frames == ()
        assert again.manifest.rejected[0].stop == 0
        put(again, 0, b"anew")
    with SessionStore.open(store.path, writable=True) as third:
        assert third.recovery == Recovery()
        assert len(third.manifest.rejected) == 1


def test_strangers_files_stay_where_they_are(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    (path / "indoor" / "notes.txt").write_text("mine")
    with SessionStore.open(path, writable=True) as store:
        assert store.recovery == Recovery()
    assert (path / "indoor" / "notes.txt").read_text() == "mine"


def test_a_name_that_is_taken_is_never_overwritten(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        (store.path / "indoor" / "00_4s.jpg").write_bytes(b"stranger")
        record = put(store, 0, b"ours")
        assert record.file == "indoor/00_4s-2.jpg"
        assert (store.path / "indoor" / "00_4s.jpg").read_bytes() == b"stranger"


def test_one_place_takes_one_frame(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        record = put(store, 0, b"a")
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"again")
        stored = part.commit()
        with pytest.raises(SessionError, match="already"):
            store.add_frame(frame_record(Side.INDOOR, 0, stored))
        assert store.manifest.frames == (record,)


@pytest.mark.parametrize(
    "change",
    [{"size_bytes": 2}, {"file": "indoor/none.jpg"}, {"file": "outdoor/00_4s.jpg"}, {"stop": 7}],
)
def test_a_record_that_is_not_true_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"a")
        record = frame_record(Side.INDOOR, 0, part.commit()).model_copy(update=change)
        with pytest.raises(SessionError):
            store.add_frame(record)
        assert store.manifest.frames == ()


def test_a_withdrawn_frame_makes_room_for_another(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    (path / "indoor" / "01_1-4s.jpg").unlink()
    with SessionStore.open(path, writable=True) as store:
        assert store.recovery.damaged == ("indoor/01_1-4s.jpg is missing",)
        assert store.withdraw_frame(Side.INDOOR, 1, "jpeg", "lost").file is None
        assert store.withdraw_frame(Side.INDOOR, 2, "jpeg", "blurred").file == "rejected/indoor_02_1-60s.jpg"
        assert store.manifest.missing_stops(Side.INDOOR) == (1, 2)
        put(store, 1, b"new")
        put(store, 2, b"new too")
        expected = store.manifest
        with pytest.raises(SessionError, match="no jpeg frame"):
            store.withdraw_frame(Side.OUTDOOR, 1, "jpeg", "never was")
    with SessionStore.open(path, writable=True) as again:
        assert again.manifest == expected
        assert again.recovery == Recovery()


@pytest.mark.parametrize("fields", [{"frames": ()}, {"session_id": "0" * 32}, {"nonsense": 1}, {"camera_height_m": -1}])
def test_fixed_fields_and_bad_values_are_refused(tmp_path: Path, fields: dict[str, object]) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        before = store.manifest
        with pytest.raises(SessionError, match="updated"):
            store.update(**fields)
        assert store.manifest == before


def test_the_stores_own_journal_kinds_are_refused(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store, pytest.raises(SessionError, match="own"):
        store.event("frame", file="indoor/x.jpg")


def test_one_session_one_writer(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    with SessionStore.open(path, writable=True), pytest.raises(SessionLockedError, match=f"process {os.getpid()} on"):
        SessionStore.open(path, writable=True)
    SessionStore.open(path, writable=True).close()


def _hold(path: Path, ready: multiprocessing.synchronize.Event) -> None:
    with SessionStore.open(path, writable=True):
        ready.set()
        threading.Event().wait(60)


def test_a_killed_holder_leaves_no_lock(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    spawn = multiprocessing.get_context("spawn")
    ready = spawn.Event()
    holder = spawn.Process(target=_hold, args=(path, ready))
    holder.start()
    assert ready.wait(120)
    with pytest.raises(SessionLockedError, match=f"process {holder.pid} on"):
        SessionStore.open(path, writable=True)
    holder.kill()
    holder.join(120)
    holder.close()
    with SessionStore.open(path, writable=True) as store:
        assert store.manifest.status is SessionStatus.COMPLETE


def test_reading_takes_no_lock_and_changes_nothing(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    (path / ".part-left").write_bytes(b"x")
    files = {p: p.stat().st_mtime_ns for p in path.rglob("*")}
    with SessionStore.open(path, writable=False) as store:
        assert len(store.manifest.frames) == 3
        for change in (store.save_manifest, lambda: store.begin_frame(Side.INDOOR, 0, 4.0)):
            with pytest.raises(SessionError, match="not open for writing"):
                change()
    assert {p: p.stat().st_mtime_ns for p in path.rglob("*")} == files


def test_two_cameras_at_once_lose_nothing(tmp_path: Path) -> None:
    stops_s = tuple(4.0 / 2**i for i in range(12))
    bracket = {"mode": "full", "stops_s": stops_s, "sides": ["indoor", "outdoor"]}
    with SessionStore.create(tmp_path, manifest(bracket=bracket)) as store:

        def camera(side: Side) -> None:
            for stop, asked_s in enumerate(stops_s):
                part = store.begin_frame(side, stop, asked_s)
                part.write(f"{side} {stop}".encode())
                stored = part.commit()
                facts = {"asked_s": asked_s, "camera_s": asked_s}
                store.add_frame(frame_record(side, stop % 3, stored).model_copy(update={"stop": stop, **facts}))

        threads = [threading.Thread(target=camera, args=(side,)) for side in Side]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert store.finish().status is SessionStatus.COMPLETE
    with SessionStore.open(store.path, writable=True) as again:
        assert len(again.manifest.frames) == 24
        for frame in again.manifest.frames:
            assert (again.path / frame.file).read_text() == f"{frame.side} {frame.stop}"


def test_a_missing_or_damaged_manifest_comes_back_from_the_journal(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    expected = load_manifest(path)
    for damage in (lambda f: f.unlink(), lambda f: f.write_bytes(b"{broken"), lambda f: f.write_bytes(b"")):
        damage(path / "session.json")
        with SessionStore.open(path, writable=True) as store:
            assert store.recovery.manifest
            assert store.manifest == expected
        assert load_manifest(path) == expected
    assert (path / "rejected" / "damaged-session.json").read_bytes() == b"{broken"
    assert (path / "rejected" / "damaged-session-2.json").read_bytes() == b""


def test_a_session_without_a_journal_gets_one(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    expected = load_manifest(path)
    (path / "journal.jsonl").unlink()
    for _ in range(2):
        with SessionStore.open(path, writable=True) as store:
            assert store.manifest == expected
    (path / "session.json").unlink()
    with SessionStore.open(path, writable=True) as store:
        assert store.manifest == expected


def test_what_a_shortened_journal_lost_comes_back_from_the_manifest(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    expected = load_manifest(path)
    journal = path / "journal.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:-2]))
    with SessionStore.open(path, writable=True) as store:
        assert store.recovery.restored == ("frame indoor/02_1-60s.jpg",)
        assert store.manifest == expected
    with SessionStore.open(path, writable=True) as store:
        assert store.recovery == Recovery()


def test_manifest_and_journal_of_two_sessions_are_refused(tmp_path: Path) -> None:
    first, second = complete_session(tmp_path), complete_session(tmp_path)
    other = load_manifest(second).model_copy(update={"session_id": "cd" * 16})
    (first / "session.json").write_text(other.model_dump_json())
    with pytest.raises(SessionError, match="two sessions"):
        SessionStore.open(first, writable=True)


def test_damage_within_the_journal_is_refused_and_named(tmp_path: Path) -> None:
    path = complete_session(tmp_path)
    raw = bytearray((path / "journal.jsonl").read_bytes())
    raw[raw.index(b"\n") + 60] ^= 1
    (path / "journal.jsonl").write_bytes(raw)
    with pytest.raises(JournalError, match="line 2"):
        SessionStore.open(path, writable=True)


def test_no_session_and_not_even_a_lock_file_is_made(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(SessionNotFoundError):
            SessionStore.open(path, writable=True)
    assert list(tmp_path.iterdir()) == []


def hostile_indoor_link(path: Path, outside: Path) -> None:
    (path / "indoor").rename(outside / "moved")
    (path / "indoor").symlink_to(outside / "moved")


def hostile_lock_link(path: Path, outside: Path) -> None:
    (path / ".lock").unlink()
    (path / ".lock").symlink_to(outside / "victim")


def hostile_lock_pipe(path: Path, outside: Path) -> None:
    (path / ".lock").unlink()
    os.mkfifo(path / ".lock")


def hostile_journal_link(path: Path, outside: Path) -> None:
    (path / "journal.jsonl").rename(outside / "journal")
    (path / "journal.jsonl").symlink_to(outside / "journal")


def hostile_journal_pipe(path: Path, outside: Path) -> None:
    (path / "journal.jsonl").unlink()
    os.mkfifo(path / "journal.jsonl")


def hostile_journal_hard_link(path: Path, outside: Path) -> None:
    os.link(path / "journal.jsonl", outside / "journal")


@pytest.mark.parametrize(
    "make",
    [
        hostile_indoor_link,
        hostile_lock_link,
        hostile_lock_pipe,
        hostile_journal_link,
        hostile_journal_pipe,
        hostile_journal_hard_link,
    ],
)
def test_links_and_pipes_are_not_followed(tmp_path: Path, make) -> None:  # type: ignore[no-untyped-def]
    path = complete_session(tmp_path / "in")
    outside = tmp_path / "out"
    outside.mkdir()
    (outside / "victim").write_bytes(b"precious")
    make(path, outside)
    with pytest.raises(IntegrityError):
        SessionStore.open(path, writable=True)
    assert (outside / "victim").read_bytes() == b"precious"


def test_a_manifest_that_is_a_link_is_replaced_not_followed(tmp_path: Path) -> None:
    path = complete_session(tmp_path / "in")
    expected = load_manifest(path)
    outside = tmp_path / "session.json"
    (path / "session.json").rename(outside)
    (path / "session.json").symlink_to(outside)
    with pytest.raises(ManifestError, match="link"):
        load_manifest(path)
    with SessionStore.open(path, writable=True) as store:
        assert store.manifest == expected
        store.save_manifest()
    assert not (path / "session.json").is_symlink()
    assert outside.exists()


def test_a_rejecting_that_was_cut_short_keeps_its_reason(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 1, STOPS_S[1])
        part.write(b"x")
        file = part.reject("black frame")
    with SessionStore.open(store.path, writable=True) as again:
        assert again.manifest.rejected == (RejectedFrame(side=Side.INDOOR, stop=1, file=file, reason="black frame"),)


def test_a_failed_creation_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(folder_module.durable.os_calls, "fsync", fails)
    with pytest.raises(Exception, match="No space"):
        SessionStore.create(tmp_path, manifest())
    assert list(tmp_path.iterdir()) == []
