"""Results on disk: damage is found, two processes do not meet, what a kill leaves is put right."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from processing.pictures.images import RelativeImage
from processing.pipeline import Artifact, Stage
from processing.running.artifacts import Shelf, load, save
from processing.running.fingerprint import DigestMemory
from processing.running.requests import RunRequest
from processing.running.result_store import ResultStore
from processing.running.results import Action, RunReport, parse_result
from processing.running.runner import process
from processing.sphere import Equirectangular
from station.errors import DiskFullError, IntegrityError, SessionLockedError, SessionNotFoundError
from station.session import durable
from station.session.durable import SessionLock
from station.session.folder import Folder
from tests.processing.running.toy_stages import TOYS, contents
from tests.station.session.sessions import complete_session
from tests.torture.os_faults import Counting, installed

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_STATE", str(tmp_path / "state"))


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = complete_session(tmp_path / "sessions")
    process(path, RunRequest(), stages=TOYS)
    return path


def run(session: Path, **request: object) -> RunReport:
    return process(session, RunRequest(**request), stages=TOYS)


def actions(report: RunReport) -> list[str]:
    return [stage.action.value for stage in report.stages]


def flip(path: Path) -> None:
    """Change one bit, and set the time of the content back, as a careless program may."""
    info = path.stat()
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(info.st_atime_ns, info.st_mtime_ns))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def remove(path: Path) -> None:
    path.unlink()


def link(path: Path) -> None:
    path.rename(path.with_name("aside"))
    path.symlink_to("aside")


@pytest.mark.parametrize("file", ["total.json", "result.json"])
@pytest.mark.parametrize("harm", [flip, cut, remove, link])
def test_a_damaged_result_is_refused_and_made_anew(session: Path, file: str, harm: object) -> None:
    before = contents(session)
    harm(session / "stages" / "total" / file)  # type: ignore[operator]
    report = run(session)
    assert actions(report) == ["skipped", "ran", "skipped"], "the new result is what it was"
    assert "cannot be used" in report.stages[1].reason
    assert file in report.stages[1].reason
    assert contents(session) == before


def test_silent_damage_is_found_by_recheck(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that corrupts a file changes no time: the memory believes that nothing has changed."""
    memory_file = session / "stages" / ".digests.json"
    path = session / "stages" / "total" / "total.json"
    flip(path)
    info = path.stat()
    known = json.loads(memory_file.read_text())
    known["stages/total/total.json"][0] = f"{info.st_size} {info.st_mtime_ns} {info.st_ctime_ns} {info.st_ino}"
    memory_file.write_text(json.dumps(known))
    assert actions(run(session)) == ["skipped"] * 3
    assert actions(run(session, recheck=True)) == ["skipped", "ran", "skipped"]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"a": 1}', '{"a": [1]}', '{"a": ["x", "y", "z"]}'])
def test_a_broken_digest_memory_is_forgotten(session: Path, text: str) -> None:
    (session / "stages" / ".digests.json").write_text(text)
    assert actions(run(session)) == ["skipped"] * 3


def test_a_result_of_another_stage_or_edited_by_hand_is_not_believed(session: Path) -> None:
    folder = session / "stages"
    shutil.copy(folder / "frames" / "result.json", folder / "total" / "result.json")
    assert "of another stage" in run(session).stages[1].reason
    data = json.loads((folder / "half" / "result.json").read_text())
    data["metrics"] = {"better": 1}
    (folder / "half" / "result.json").write_text(json.dumps(data))
    assert "has changed since it was written" in run(session).stages[2].reason


@pytest.mark.parametrize("name", ["../../session.json", "/etc/passwd", ".hidden", "a/b", ""])
def test_a_result_cannot_name_files_elsewhere(session: Path, name: str) -> None:
    data = json.loads((session / "stages" / "total" / "result.json").read_text())
    data["files"] = {name: data["files"]["total.json"]}
    with pytest.raises(ValueError, match="files"):
        parse_result(json.dumps(data).encode())


def test_a_link_in_the_place_of_the_results_is_refused(session: Path, tmp_path: Path) -> None:
    (session / "stages").rename(tmp_path / "elsewhere")
    (session / "stages").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(IntegrityError, match="link"):
        run(session)


def test_no_session_there(tmp_path: Path) -> None:
    with pytest.raises(SessionNotFoundError):
        run(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_two_processes_do_not_work_at_once(session: Path) -> None:
    code = (
        "import sys; from pathlib import Path\n"
        "from station.session.folder import Folder; from station.session.durable import SessionLock\n"
        "lock = SessionLock(Folder.open(Path(sys.argv[1]))); print('held', flush=True); sys.stdin.read()"
    )
    arguments = [sys.executable, "-c", code, str(session)]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as other:
        assert other.stdout
        assert other.stdout.readline() == "held\n"
        with pytest.raises(SessionLockedError, match=str(other.pid)):
            run(session)
        assert actions(run(session, dry_run=True)) == ["skipped"] * 3, "looking is free"
        other.communicate()
    assert actions(run(session)) == ["skipped"] * 3


def test_the_lock_is_given_back_after_a_failure(session: Path) -> None:
    (session / "stages" / "total").rename(session / "stages" / "was")
    (session / "stages" / "total").symlink_to("was")
    with pytest.raises(IntegrityError):
        run(session)
    SessionLock(Folder.open(session)).release()


class NoExchange(durable.OsCalls):
    """A system that cannot swap two folders in one step."""

    def exchange(self, source: str, target: str, *, dir_fd: int) -> bool:
        return False


class StopAtRename(Counting):
    """Fails at the Nth rename from the start, without any exchange."""

    def __init__(self, nth: int) -> None:
        super().__init__()
        self.left = nth

    def exchange(self, source: str, target: str, *, dir_fd: int) -> bool:
        return False

    def rename(self, source: str, target: str, *, src_dir_fd: int, dst_dir_fd: int) -> None:
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        super().rename(source, target, src_dir_fd=src_dir_fd, dst_dir_fd=dst_dir_fd)


def test_without_an_exchange_the_old_folder_is_moved_aside(session: Path) -> None:
    with installed(NoExchange()):
        assert actions(run(session, options={"--scale": 2.0})) == ["skipped", "ran", "ran"]
    hidden = [p.name for p in (session / "stages").iterdir() if p.name.startswith(".")]
    assert hidden == [".digests.json"]
    assert actions(run(session, options={"--scale": 2.0})) == ["skipped"] * 3


@pytest.mark.parametrize("nth", range(5))
def test_cut_between_any_two_renames_the_old_or_the_new_result_stands(session: Path, nth: int) -> None:
    old = contents(session)
    with pytest.raises(KeyboardInterrupt), installed(StopAtRename(nth)):
        run(session, options={"--scale": 2.0})
    with Stages(session) as folder:
        store = ResultStore(folder, DigestMemory(None))
        store.recover()
        stored = store.read("total")
        assert stored.result is not None, stored.problem
        scale = stored.result.ingredients["parameters"]["scale"]  # type: ignore[index,call-overload]
        assert scale in (1.0, 2.0)
    run(session)
    assert contents(session) == old


class Stages:
    def __init__(self, session: Path) -> None:
        self.folder = Folder.open(session / "stages")

    def __enter__(self) -> Folder:
        return self.folder

    def __exit__(self, *_: object) -> None:
        self.folder.close()


class FullDisk(durable.OsCalls):
    """No space for the Nth write."""

    def __init__(self, nth: int) -> None:
        self.left = nth

    def write(self, fd: int, data: bytes | memoryview) -> int:
        self.left -= 1
        if self.left < 0:
            raise OSError(28, "No space left on device")
        return super().write(fd, data)


@pytest.mark.parametrize("nth", range(1, 6))
def test_a_full_disk_leaves_what_was_there(session: Path, nth: int) -> None:
    before = contents(session)
    with pytest.raises(DiskFullError), installed(FullDisk(nth)):
        run(session, options={"--scale": 2.0})
    with Stages(session) as folder:
        assert [n for n in folder.names() if n.startswith((".part-", ".old-"))] == []
    run(session)
    assert contents(session) == before


def test_a_disk_that_fills_up_while_a_stage_writes_by_itself(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """NumPy's and Python's own writing name no file: the stage's folder is named."""

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(DiskFullError, match="frames"):
        run(session, options={"--rounds": 5})


def test_leftovers_of_a_killed_run_are_cleared(session: Path) -> None:
    left = session / "stages" / ".part-0badcafe-total"
    (left / "deep").mkdir(parents=True)
    (left / "total.json").write_text("{")
    (left / "deep" / "x").write_text("x")
    (session / "stages" / "total").rename(session / "stages" / ".old-total")
    assert actions(run(session)) == ["skipped"] * 3
    assert not left.exists()
    assert (session / "stages" / "total").exists()


def test_shelf_holds_only_what_is_still_needed() -> None:
    big = np.zeros(3, np.float32)
    shelf = Shelf(lambda _stage, name: None if name == "absent" else f"{name} from disk")
    shelf.put("merge", "indoor", big)
    assert shelf.get("merge", "indoor") is big
    assert shelf.get("merge", "absent") is None
    assert shelf.get("verify", "x") == "x from disk"
    assert shelf.held == ("merge/indoor", "verify/x")
    shelf.drop_unneeded((Stage("calibrate", 1, "", "", needs=("merge",)), Stage("report", 1, "", "")))
    assert shelf.held == ("merge/indoor",)
    shelf.drop_unneeded(())
    assert shelf.held == ()


def test_what_is_handed_on_cannot_be_changed_on_the_way() -> None:
    picture = RelativeImage(
        np.ones((2, 4, 3), np.float32),
        np.ones((2, 4), np.float32),
        np.zeros((2, 4), np.uint8),
        Equirectangular(4, 2),
    )
    shelf = Shelf(lambda _stage, _name: None)
    shelf.put("merge", "indoor", picture)
    shelf.put("merge", "response", {"curve": [1]})
    handed_on = shelf.get("merge", "indoor")
    assert isinstance(handed_on, RelativeImage)
    for plane in (handed_on.rgb, handed_on.uncertainty, handed_on.validity):
        with pytest.raises(ValueError, match="read-only"):
            plane[0, 0] = 0
    shelf.get("merge", "response")["curve"].append(2)  # type: ignore[index]
    assert shelf.get("merge", "response") == {"curve": [1]}


def test_pictures_and_values_are_the_same_from_memory_and_from_disk(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    picture = RelativeImage(
        rgb=rng.random((8, 16, 3), np.float32),
        uncertainty=rng.random((8, 16), np.float32) + np.float32(0.01),
        validity=np.zeros((8, 16), np.uint8),
        geometry=Equirectangular(16, 8),
    )
    artifact = Artifact("indoor", "picture")
    handed_on = save(artifact, picture, tmp_path)
    from_disk = load(artifact, tmp_path / "indoor.exr")
    assert isinstance(handed_on, RelativeImage)
    assert isinstance(from_disk, RelativeImage)
    np.testing.assert_array_equal(handed_on.rgb, from_disk.rgb)
    np.testing.assert_array_equal(handed_on.uncertainty, from_disk.uncertainty)
    assert from_disk.geometry == picture.geometry
    values = Artifact("values", "json")
    assert save(values, {"a": (1, 2.5)}, tmp_path) == load(values, tmp_path / "values.json") == {"a": [1, 2.5]}
    with pytest.raises(ValueError, match="JSON compliant"):
        save(values, {"a": float("nan")}, tmp_path)


def test_the_report_sums_up(session: Path) -> None:
    report = run(session, force=("total",))
    reported = report.to_dict()
    assert reported["stages"][1]["action"] == Action.RAN.value
    assert reported["stages"][1]["cost"]["peak_bytes"] > 1e6
    assert reported["peak_bytes"] >= reported["stages"][1]["cost"]["peak_bytes"]
    json.dumps(reported)
