from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from station.capture.preflight import check_disk
from station.capture.rig_file import LimitsTable
from station.errors import DiskError, DiskFullError, IntegrityError, ResourceError
from station.session import durable
from station.session.folder import Folder, make_folders, write_file
from station.session.session import Side
from station.session.store import SessionStore
from station.session.verify import verify_session
from tests.station.session.sessions import frame_record, manifest, put


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.ENOSPC, DiskFullError),
        (errno.EDQUOT, DiskFullError),
        (errno.EIO, DiskError),
        (errno.EROFS, DiskError),
        (errno.EACCES, DiskError),
        (errno.EFBIG, DiskError),
        (errno.ENOENT, DiskError),
        (errno.EMFILE, ResourceError),
        (errno.ENOMEM, ResourceError),
    ],
)
def test_each_error_has_its_type_and_names_the_file(number: int, kind: type[ResourceError]) -> None:
    with pytest.raises(ResourceError) as caught, durable.disk_errors(Path("indoor/x.jpg"), "writing"):
        raise OSError(number, os.strerror(number))
    assert type(caught.value) is kind
    assert caught.value.where == "indoor/x.jpg"
    assert caught.value.details["errno"] == errno.errorcode[number]
    assert caught.value.advice


def test_a_name_that_cannot_be_is_not_blamed_on_the_disk(tmp_path: Path) -> None:
    with pytest.raises(DiskError) as caught, durable.disk_errors(tmp_path, "writing"):
        (tmp_path / ("y" * 300)).mkdir()
    assert caught.value.advice == "choose another name or folder"


def test_a_write_without_progress_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(durable.os_calls, "write", lambda _fd, _data: 0)
    with pytest.raises(OSError, match="no progress"):
        durable.write_all(1, b"abc")


def test_a_replaced_file_is_the_old_or_the_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Folder.open(tmp_path)
    write_file(folder, "a", b"old")

    def fails(_fd: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(durable.os_calls, "fsync", fails)
        with pytest.raises(DiskError, match="a: writing failed"):
            write_file(folder, "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a"]
    write_file(folder, "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"new"
    folder.close()


def test_a_file_that_grew_or_shrank_on_disk_does_not_count(tmp_path: Path) -> None:
    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"abcdef")
        os.truncate(part.path, 3)
        with pytest.raises(DiskError, match="3 of 6 bytes"):
            part.commit()
        part.abort()
        assert list((store.path / "indoor").iterdir()) == []


def test_a_frame_whose_sync_failed_is_void(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_fd: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"abc")
        with monkeypatch.context() as patch:
            patch.setattr(durable.os_calls, "fsync", fails)
            with pytest.raises(DiskError):
                part.commit()
        with pytest.raises(Exception, match="frame is failed"):
            part.commit()
        with pytest.raises(Exception, match="frame is failed"):
            part.write(b"more")
        part.abort()


def test_what_was_not_journalled_is_not_in_the_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with SessionStore.create(tmp_path, manifest()) as store:
        part = store.begin_frame(Side.INDOOR, 0, 4.0)
        part.write(b"abc")
        record = frame_record(Side.INDOOR, 0, part.commit())
        before = store.manifest
        with monkeypatch.context() as patch:
            patch.setattr(durable.os_calls, "fdatasync", fails)
            for change in (lambda: store.add_frame(record), lambda: store.update(drift_frac=0.5)):
                with pytest.raises(DiskFullError):
                    change()
                assert store.manifest == before
        store.add_frame(record)
        assert store.manifest.frames == (record,)


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP, errno.ENOSYS], ids=errno.errorcode.get)
def test_a_disk_that_syncs_no_folder_and_has_no_modes_takes_a_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """As Linux answers for /proc, VirtualBox's shared folders and some network disks; files are synced all the same."""
    synced: list[int] = []

    def sync(fd: int) -> None:
        if stat.S_ISDIR(os.fstat(fd).st_mode):
            raise OSError(number, os.strerror(number))
        synced.append(fd)
        os.fsync(fd)

    def no_modes(_fd: int, _mode: int) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(durable.os_calls, "fsync", sync)
    monkeypatch.setattr(durable.os_calls, "fchmod", no_modes)
    with SessionStore.create(tmp_path / "new" / "sessions", manifest()) as store:
        synced.clear()
        put(store, 0, b"abc")
        assert len(synced) == 1
        path = store.path
        store.finish()
    assert verify_session(path).intact
    with pytest.raises(OSError, match="Input/output"), durable.where_possible():
        raise OSError(errno.EIO, "Input/output error")


def test_parents_are_made(tmp_path: Path) -> None:
    make_folders(tmp_path / "a" / "b" / "c")
    make_folders(tmp_path / "a" / "b" / "c")
    assert (tmp_path / "a" / "b" / "c").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(DiskError, match="creating"):
        make_folders(tmp_path / "file" / "below")


@pytest.fixture
def forbidden(tmp_path: Path) -> Iterator[Path]:
    """A folder in one that we may not enter; as root by being nobody meanwhile."""
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700 if os.geteuid() == 0 else 0)
    if os.geteuid() == 0:
        os.seteuid(65534)
        yield closed / "sessions"
        os.seteuid(0)
    else:
        yield closed / "sessions"
        closed.chmod(0o700)


@pytest.mark.parametrize("place", ["file", "file/sessions", "circle", "circle/sessions"])
def test_no_folder_can_be_made_in_what_is_none(tmp_path: Path, place: str) -> None:
    """`daylit doctor` said ok, and the capture failed after it had set up all instruments."""
    (tmp_path / "file").write_text("no folder")
    (tmp_path / "circle").symlink_to("circle")
    assert check_disk(tmp_path / place, LimitsTable(min_free_disk_mb=0), 0).level == "fail"
    assert check_disk(tmp_path / "new" / "sessions", LimitsTable(min_free_disk_mb=0), 0).level == "ok"


def test_a_folder_that_may_not_be_entered_is_named(forbidden: Path) -> None:
    """As the disk of another user under /media; the check before a capture says so, too."""
    found = check_disk(forbidden, LimitsTable(min_free_disk_mb=0), 0)
    assert found.level == "fail"
    assert found.text.endswith("is not a folder that can be written to")
    with pytest.raises(DiskError, match="Permission denied") as caught:
        make_folders(forbidden)
    assert "choose a folder you can write to" in caught.value.advice


def test_a_file_is_read_only_up_to_its_limit(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"12345")
    folder = Folder.open(tmp_path)
    assert folder.read_file("a", 5) == b"12345"
    assert folder.read_file("none", 5) is None
    with pytest.raises(IntegrityError, match="larger than 4"):
        folder.read_file("a", 4)
    folder.close()
