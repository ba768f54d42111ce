"""Sessions by URL, on a local object store: found, done once, done again with other options; folders by file://."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from processing.batch import store
from processing.batch.store import DONE, Store, done_of, is_url, remote_sessions, work_by_url
from processing.batch.work import Outcome, Task
from processing.errors import ParameterError, StoreError
from tests.torture.faulty_store import BUCKET, digested, object_store, put_session, whole_or_not_done


def test_sessions_by_url_on_an_object_store(monkeypatch: pytest.MonkeyPatch) -> None:
    with object_store() as files:
        monkeypatch.setenv("AWS_ENDPOINT_URL", files.endpoint_url)
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        root = put_session(files, "monday/one")
        assert remote_sessions(f"s3://{BUCKET}", 3) == [f"s3://{root}"]
        task = Task(f"s3://{root}", "monday/one", ("--x",), 60.0)
        assert work_by_url(task, do=digested).stages == {"merge": "ran", "report": "ran"}
        assert work_by_url(task, do=digested).stages == {"merge": "skipped", "report": "skipped"}
        first = done_of(Store.at(task.session))
        assert first is not None
        assert work_by_url(Task(task.session, task.name, ("--y",), 60.0), do=digested).stages["merge"] == "ran"
        assert whole_or_not_done(files, root) == ""
        assert not files.find(f"{root}/{first['prefix']}"), "the former results are gone"
        assert not Store.at(task.session).create(DONE, b"another's"), "a conditional put: what is there stays"


def test_a_folder_by_url(tmp_path: Path) -> None:
    session = tmp_path / "rooms" / "one"
    (session / "indoor").mkdir(parents=True)
    (session / "session.json").write_text("{}")
    url = (tmp_path / "rooms").as_uri()
    assert is_url(url)
    assert remote_sessions(url, 3) == [f"{url}/one"]
    assert work_by_url(Task(f"{url}/one", "one", (), 60.0), do=digested).state == "done"
    assert json.loads((session / DONE).read_text())["stages"] == {"merge": "ran", "report": "ran"}
    with pytest.raises(ParameterError, match="no sessions"):
        remote_sessions(f"{url}/one/indoor", 3)


def test_what_a_result_depends_on_beside_the_arguments_is_not_skipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder of furniture, the zone of the table's row, an installed network; and what is forced."""
    session, furniture, models = tmp_path / "one", tmp_path / "own", tmp_path / "models"
    for folder in (session / "indoor", furniture, models):
        folder.mkdir(parents=True)
    (session / "session.json").write_text("{}")
    (furniture / "sofa.obj").write_text("v 0 0 0")
    monkeypatch.setenv("DAYLIT_MODELS", str(models))
    task = Task(session.as_uri(), "one", ("--furniture", str(furniture)), 60.0)

    def ran(task: Task) -> bool:
        return work_by_url(task, do=digested).stages["merge"] == "ran"

    assert ran(task)
    assert not ran(task)
    (furniture / "sofa.obj").write_text("v 1 0 0")
    assert ran(task), "the furniture has changed"
    assert ran(abroad := replace(task, zone="Asia/Tokyo")), "the row is in another zone"
    assert not ran(abroad)
    monkeypatch.setattr(store, "installed", lambda: furniture / "sofa.obj")
    assert ran(abroad), "a network was installed"
    assert not ran(abroad)
    assert ran(forced := replace(abroad, arguments=(*abroad.arguments, "--force", "merge")))
    assert ran(forced), "forced is forced each time"


def test_what_a_store_does_wrong_is_listed(tmp_path: Path) -> None:
    url = tmp_path.as_uri()
    assert work_by_url(Task(f"{url}/none", "none", (), 60.0), do=digested, sleep=lambda _s: None).code == "BAT-005"
    (tmp_path / "session.json").write_text("{}")
    (tmp_path / DONE).write_text("[]")
    outcome = work_by_url(Task(url, "one", (), 60.0), do=digested)
    assert (outcome.code, (tmp_path / DONE).read_text()) == ("BAT-005", "[]"), "not ours: left alone"
    (tmp_path / DONE).unlink()
    failed = Outcome("one", "failed", "CAL-003", "no scale")
    assert work_by_url(Task(url, "one", (), 60.0), do=lambda _task: failed).code == "CAL-003"
    assert not (tmp_path / DONE).exists()
    with pytest.raises(StoreError, match="cannot be opened"):
        Store.at("nothing://such")


def test_what_a_store_raises_of_its_own_is_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as botocore's NoCredentialsError, which is neither an `OSError` nor a `RuntimeError`."""

    class NoCredentialsError(Exception):
        pass

    def find(*_args: object, **_options: object) -> None:
        raise NoCredentialsError("Unable to locate credentials")

    there = Store.at(tmp_path.as_uri(), sleep=lambda _s: None)
    monkeypatch.setattr(there.files, "find", find, raising=False)
    with pytest.raises(StoreError, match="listing: Unable to locate credentials"):
        there.sizes()
