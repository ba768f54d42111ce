"""Many sessions on a real local cluster of two workers, one of which is killed in the middle."""

from __future__ import annotations

import csv
import gc
import io
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import daylit
from processing.batch.cluster import (
    connected,
    here_among,
    machine_of,
    put_away,
    thread_settings,
    threads_each,
    usual_workers,
)
from processing.batch.rows import COLUMNS, PAPER_COLUMNS, guarded, orientation, session_row, write_table
from processing.batch.run import BatchReport, find_sessions
from processing.batch.work import Outcome
from processing.commands.batch import summary_lines
from processing.errors import ClusterError, ParameterError
from processing.ground.room_model import starter_room, write_room
from tests.station.session.sessions import complete_session

ROOT = Path(__file__).resolve().parents[3]
NAMES = ("a", "b", "broken", "cursed", "mortal")

RUN = """
import json, sys, threading
from pathlib import Path
from distributed import LocalCluster
from processing.batch.run import BatchRequest, run_batch
from tests.processing.batch.doings import as_named, together

def there():
    return LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", host="127.0.0.1",
        dashboard_address=None, worker_dashboard_address=None,
    )

def done(folder, do, **where):
    return run_batch(BatchRequest(Path(sys.argv[1], folder), **where), do=do).to_dict()

if __name__ == "__main__":
    found = {"killed": done("killed", as_named, workers=2)}
    with there() as cluster:
        found["elsewhere"] = done("elsewhere", as_named, cluster=cluster.scheduler_address)
    with there() as cluster:
        threading.Timer(1.0, lambda: cluster.scale(4)).start()
        found["late"] = done("late", together, cluster=cluster.scheduler_address)
    print(json.dumps(found))
"""


def empty_sessions(folder: Path, names: tuple[str, ...]) -> None:
    for name in names:
        (folder / name).mkdir(parents=True)
        (folder / name / "session.json").write_text("{}")


@dataclass(frozen=True)
class Batches:
    """What became of three folders of sessions, and where they are."""

    folder: Path
    reports: dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def batches(tmp_path_factory: pytest.TempPathFactory) -> Batches:
    """In one process of their own: a cluster's threads and sockets are none of the other tests' business.

    A session is given up after two deaths of its worker, not four: each one's successor takes a CPU second to start.
    """
    folder = tmp_path_factory.mktemp("batches")
    for name, sessions in (("killed", NAMES), ("elsewhere", ("a", "b")), ("late", ("a", "b", "c", "d"))):
        empty_sessions(folder / name, sessions)
    script = folder / "batch_here.py"
    script.write_text(RUN)
    done = subprocess.run(
        [sys.executable, str(script), str(folder)],
        capture_output=True,
        text=True,
        timeout=550,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return Batches(folder, json.loads(done.stdout.splitlines()[-1]))


@pytest.mark.timeout(600)
def test_killed_workers_lose_no_session_and_make_none_wrong(batches: Batches) -> None:
    report = batches.reports["killed"]
    states = {one["session"]: (one["state"], one["code"]) for one in report["outcomes"]}
    assert list(states) == sorted(NAMES)
    assert states.pop("cursed") == ("failed", "BAT-004")
    assert states.pop("broken") == ("failed", "BAT-004")
    assert set(states.values()) == {("done", "")}, "the mortal one was given to another worker"
    assert (report["sessions"], report["done"], report["failed"]) == (5, 3, 2)
    assert (batches.folder / "killed" / "mortal" / "tried-1").exists()


@pytest.mark.timeout(600)
def test_a_cluster_that_is_there_already_is_used(batches: Batches) -> None:
    report = batches.reports["elsewhere"]
    assert [(one["session"], one["state"]) for one in report["outcomes"]] == [("a", "done"), ("b", "done")]
    assert report["workers"] == 1


@pytest.mark.timeout(600)
def test_workers_that_join_late_get_sessions(batches: Batches) -> None:
    """Four workers, of which three join after a second: four sessions at once, or none of them ends."""
    report = batches.reports["late"]
    assert [one["state"] for one in report["outcomes"]] == ["done"] * 4
    assert report["at_once"] == 4


def test_sessions_are_found_in_folders_of_folders(tmp_path: Path) -> None:
    empty_sessions(tmp_path / "rooms" / "monday", ("one", "two"))
    empty_sessions(tmp_path / "rooms", ("zero", ".unfinished"))
    (tmp_path / "rooms" / "zero" / "stages" / "session.json").mkdir(parents=True)
    found = [path.relative_to(tmp_path / "rooms").as_posix() for path in find_sessions(tmp_path / "rooms")]
    assert found == ["monday/one", "monday/two", "zero"]
    with pytest.raises(ParameterError, match="no sessions"):
        find_sessions(tmp_path / "rooms" / "monday" / "one")
    with pytest.raises(ParameterError, match="not a folder"):
        find_sessions(tmp_path / "elsewhere")


def test_a_row_has_the_papers_columns(tmp_path: Path) -> None:
    row = session_row(complete_session(tmp_path), "America/New_York")
    assert (row["date"], row["theta_time"], row["scene_name"]) == ("20230519", "11:54", "coda 320")
    outcomes = [Outcome("x", "done", row=row, seconds=1.0), Outcome("y", "failed", "CAL-003", "no\nscale")]
    read = list(
        csv.DictReader(io.StringIO(write_table(tmp_path, BatchReport(tmp_path, outcomes))[0].read_text("utf-8")))
    )
    assert tuple(read[0]) == COLUMNS
    assert COLUMNS[: len(PAPER_COLUMNS)] == PAPER_COLUMNS
    assert [one["index"] for one in read] == ["1", "2"]
    assert read[1]["message"] == "no scale"
    assert read[1]["code"] == "CAL-003"


def test_a_row_of_an_imported_session_is_dated_by_its_frames_or_not_at_all(tmp_path: Path) -> None:
    """Not by the day of its import."""
    session = complete_session(tmp_path)
    facts = json.loads((session / "session.json").read_text())
    facts["bracket"]["mode"] = "imported"
    (session / "session.json").write_text(json.dumps(facts))
    row = session_row(session, "America/New_York")
    assert (row["date"], row["theta_time"], row["utc"]) == ("", "", "")
    facts["frames"][0]["taken_utc"] = "2019-06-02T01:30:00Z"
    (session / "session.json").write_text(json.dumps(facts))
    row = session_row(session, "America/New_York")
    assert (row["date"], row["theta_time"], row["utc"]) == ("20190601", "21:30", "2019-06-02T01:30Z")


def test_of_the_sessions_done_those_that_were_tried_twice_are_counted() -> None:
    outcomes = [
        Outcome("a", "done"),
        Outcome("b", "done", tries=2),
        Outcome("c", "failed", "BAT-002", "killed", tries=2),
    ]
    *_, last = summary_lines(BatchReport(Path("rooms"), outcomes, seconds=1.0))
    assert last.startswith("2 of 3 sessions done, 1 of them after a second try, 1 failed")


def test_headings_are_written_as_the_paper_does() -> None:
    assert [orientation(degrees * 3.141592653589793 / 180) for degrees in (328, 139, 0, 359.7, -90)] == [
        "328°NW",
        "139°SE",
        "0°N",
        "0°N",
        "270°W",
    ]
    assert orientation(None) == ""


@pytest.mark.parametrize(
    ("text", "shown"),
    [("=1+1", "'=1+1"), ("@x", "'@x"), ("-0.5", "-0.5"), ("-1e-05", "-1e-05"), ("+a", "'+a"), ("a=b", "a=b"), ("", "")],
)
def test_no_cell_is_a_formula(text: str, shown: str) -> None:
    assert guarded(text) == shown


def test_the_table_is_written_whole(tmp_path: Path) -> None:
    table, values = write_table(tmp_path / "out", BatchReport(tmp_path, [Outcome("x", "done")], 2, 1.5))
    assert json.loads(values.read_text())["done"] == 1
    assert table.read_text().count("\n") == 2


def test_workers_share_the_cores() -> None:
    assert usual_workers() >= 1
    assert threads_each(1) >= threads_each(2) >= threads_each(10_000) == 1
    assert machine_of("tcp://10.0.0.5:41234") == "10.0.0.5"
    assert here_among({"10.0.0.5": 4}) == 1, "outside a worker there is nobody to share with"
    assert thread_settings(3)["OMP_NUM_THREADS"] == "3"
    assert thread_settings(3)["OPENBLAS_NUM_THREADS"] == "1"


@pytest.fixture(scope="module")
def few_to_search() -> None:
    """What is there stays: where no scheduler answers, all else is searched for the half-made client, for a second."""
    gc.collect()
    gc.freeze()


@pytest.mark.usefixtures("few_to_search")
@pytest.mark.parametrize("address", ["no such thing", "tcp://"])
def test_a_cluster_that_is_none_is_a_named_error(tmp_path: Path, address: str) -> None:
    with pytest.raises(ClusterError), connected(address, 1, tmp_path):
        pass


@pytest.mark.usefixtures("few_to_search")
@pytest.mark.parametrize("fault", [AssertionError(), TimeoutError("timed out\nafter 30 s"), KeyError("tcp")])
def test_however_dask_refuses_an_address_it_is_the_named_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: Exception
) -> None:
    """On a busy computer Dask's client may fail an assertion of its own instead of raising what it documents."""
    import distributed

    def refuse(*_given: object, **_named: object) -> None:
        raise fault

    monkeypatch.setattr(distributed, "Client", refuse)
    with pytest.raises(ClusterError, match="no Dask scheduler answers"), connected("tcp://", 1, tmp_path):
        pass


def test_options_are_checked_once_and_not_once_a_session(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty_sessions(tmp_path / "sessions", ("a",))
    folder = str(tmp_path / "sessions")
    for wrong in (["--until", "nonsense"], ["--zone", "Mars/Olympus"], ["--cluster", "tcp://x:1", "--workers", "2"]):
        assert daylit.main(["batch", folder, *wrong, "--json"]) == 2
        assert json.loads(capsys.readouterr().out)["error"]["code"] == "USE-004"
    assert not (tmp_path / "sessions" / "batch.csv").exists()


def test_arguments_reach_each_session_as_they_were_given(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import processing.batch.run as module

    seen: list[tuple[str, ...]] = []

    def instead(request: object, _show: object) -> BatchReport:
        seen.append(request.arguments)
        return BatchReport(tmp_path, [Outcome("x", "failed", "CAL-003", "no scale")], 1, 1.0)

    monkeypatch.setattr(module, "run_batch", instead)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.json").write_text("{}")
    words = ["--until", "room", "--force", "merge", "--k1", "2.5", "--room", "room.json", "--max-error", "0.02"]
    assert daylit.main(["batch", str(tmp_path), *words]) == 5
    assert not seen, "a file that no session could use ends the batch before its first one"
    write_room(tmp_path / "room.json", starter_room(1.6).model_copy(update={"source": "given"}))
    assert daylit.main(["batch", str(tmp_path), *words]) == 5
    given = seen[0]
    assert given[given.index("--room") + 1] == str(tmp_path / "room.json")
    assert given[given.index("--k1") + 1] == "2.5"
    assert {"--force", "--until", "--max-error"} <= set(given)
    assert "--quality" not in given, "what is not given is as each session chose it"
    assert (tmp_path / "batch.csv").exists()


@pytest.mark.parametrize("fault", [AssertionError("can only join a started process"), TimeoutError()])
def test_a_cluster_that_does_not_close_undoes_nothing(fault: Exception) -> None:
    closed: list[float] = []

    class Cluster:
        def close(self, timeout: float) -> None:
            closed.append(timeout)
            raise fault

    with put_away(Cluster()):
        pass
    assert closed
    with pytest.raises(KeyError), put_away(Cluster()):
        raise KeyError
