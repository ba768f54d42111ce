"""A data set of small sessions: built, checked by us and by others, damaged, summed up."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest

import daylit
from processing.batch.dataset import (
    COLUMNS,
    MEANING,
    SUMS_NAME,
    Description,
    build,
    check,
    read_index,
    read_sums,
    split_of,
    summary,
)
from processing.errors import ParameterError, ResultFileError
from station.session.session import MANIFEST_NAME, Site
from station.session.store import SessionStore
from tests.station.session.sessions import manifest, put

ABOUT = Description("Small rooms", "CC-BY-4.0", creator="The testers", cite="Testers, 2026", date="2026-11-21")
ROOMS = ("kitchen", "kitchen", "hall", "attic")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for index, room in enumerate(ROOMS):
        given = manifest(name=room, session_id=f"{index:032x}", site=Site(latitude_deg=40.0, longitude_deg=-80.0))
        with SessionStore.create(tmp_path / "made", given) as store:
            for stop in range(3):
                put(store, stop, bytes([index, stop]) * 500)
            store.finish()
            (tmp_path / "rooms").mkdir(exist_ok=True)
            path = store.path
        path.rename(tmp_path / "rooms" / f"{index}-{room}")
    return tmp_path / "rooms"


def test_what_is_built_is_what_is_checked(folder: Path) -> None:
    made = build(folder, ABOUT, zone="America/New_York")
    assert [path.name for path in made] == ["index.csv", "LICENCE.txt", "croissant.json", SUMS_NAME]
    rows = read_index(folder)
    assert [row["room"] for row in rows] == list(ROOMS)
    assert {row["theta_time"] for row in rows} == {"11:54"}
    assert rows[0]["split"] == rows[1]["split"], "a room is in one split"
    report = check(folder)
    assert report.ok, report
    assert report.files == 3 + sum(1 for name in read_sums(folder) if "/" in name)
    before = {path.name: path.read_bytes() for path in made}
    assert {path.name: path.read_bytes() for path in build(folder, ABOUT, zone="America/New_York")} == before


def test_sha256sum_agrees(folder: Path) -> None:
    tool = shutil.which("sha256sum")
    if tool is None:
        pytest.skip("sha256sum is not installed")
    build(folder, ABOUT)
    done = subprocess.run([tool, "--check", "--quiet", SUMS_NAME], cwd=folder, capture_output=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its own libraries
def test_croissants_own_validator_takes_it(folder: Path) -> None:
    mlcroissant = pytest.importorskip("mlcroissant", reason="the validator of Croissant is not installed")
    build(folder, ABOUT)
    read = mlcroissant.Dataset(str(folder / "croissant.json"))
    assert not read.metadata.ctx.issues.errors
    assert read.metadata.name == "Small rooms"
    records = list(read.records("sessions"))
    assert len(records) == 4
    assert records[0]["sessions/room"] == b"kitchen"
    assert records[0]["sessions/latitude_deg"] == 40.0
    assert records[3]["sessions/index"] == 4


def test_every_kind_of_damage_is_reported(folder: Path) -> None:
    build(folder, ABOUT)
    frames = sorted((folder / "0-kitchen" / "indoor").iterdir())
    frames[0].write_bytes(b"other")
    frames[1].unlink()
    (folder / "2-hall" / "note.txt").write_text("later")
    (folder / "3-attic" / MANIFEST_NAME).unlink()
    text = (folder / "index.csv").read_text()
    split = read_index(folder)[0]["split"]
    line = text.splitlines()[1]
    other = line.replace(f",{split},", ",train," if split != "train" else ",test,")
    (folder / "index.csv").write_text(text.replace(line, other))
    report = check(folder)
    assert not report.ok
    assert set(report.changed) == {f"0-kitchen/indoor/{frames[0].name}", "index.csv"}
    assert set(report.missing) == {f"0-kitchen/indoor/{frames[1].name}", "3-attic/session.json"}
    assert report.new == ("2-hall/note.txt",)
    result = " ".join(report.problems)
    assert "room kitchen is in" in result
    assert "3-attic: listed in the index" in result
    assert "another index.csv" in result


@pytest.mark.parametrize("line", ["x", f"{'0' * 64}  /etc/passwd", f"{'0' * 64}  ../up", f"{'0' * 64} one-space"])
def test_checksums_that_lead_elsewhere_are_refused(folder: Path, line: str) -> None:
    build(folder, ABOUT)
    (folder / SUMS_NAME).write_text(line + "\n")
    with pytest.raises(ParameterError, match="line 1"):
        check(folder)


def test_no_index_and_no_licence_are_named(folder: Path) -> None:
    with pytest.raises(ParameterError, match="the index cannot be read"):
        check(folder)
    with pytest.raises(ParameterError, match="licence"):
        build(folder, Description("x", " "))
    (folder / "index.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ParameterError, match="columns"):
        summary(folder)


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("figures/light_figures.json", '{"a": 1}'),
        ("figures/result.json", '{"metrics": null}'),
        ("room/room.json", '{"floor": [[0], [1, 2]]}'),
        ("calibrate/calibration.json", '{"outdoor": []}'),
    ],
)
def test_a_session_whose_results_are_damaged_is_named(folder: Path, file: str, content: str) -> None:
    """It ended in an internal error, with a crash report that named no session."""
    path = folder / "2-hall" / "stages" / file
    path.parent.mkdir(parents=True)
    path.write_text(content)
    if "result" in file:
        path.with_name("light_figures.json").write_text('{"units": {"luminance": "cd/m2"}, "absolute": true}')
    with pytest.raises(ResultFileError, match="2-hall: its results are damaged"):
        build(folder, ABOUT)


def test_a_result_of_too_many_levels_counts_as_none(folder: Path) -> None:
    path = folder / "2-hall" / "stages" / "figures" / "light_figures.json"
    path.parent.mkdir(parents=True)
    path.write_text("[" * 100_000)
    assert build(folder, ABOUT)


def test_splits_are_by_share_and_stay() -> None:
    count = Counter(split_of(f"room {k}", (0.7, 0.15, 0.15)) for k in range(3000))
    assert count["train"] / 3000 == pytest.approx(0.7, abs=0.03)
    assert count["test"] / 3000 == pytest.approx(0.15, abs=0.03)
    assert {split_of(f"room {k}", (0.0, 0.0, 1.0)) for k in range(50)} == {"test"}
    with pytest.raises(ParameterError):
        split_of("room", (0.7, 0.7, -0.4))


def test_a_simulated_sets_own_table_is_used(folder: Path) -> None:
    (folder / "dataset.csv").write_text("session,natural_light,room\n0-kitchen,With electrical light,k-1\n")
    build(folder, ABOUT)
    rows = read_index(folder)
    assert (rows[0]["natural_light"], rows[0]["room"]) == ("With electrical light", "k-1")
    assert (rows[1]["natural_light"], rows[1]["room"]) == ("", "kitchen")


def test_what_columns_mean_is_said_of_columns() -> None:
    assert set(MEANING) <= set(COLUMNS)


def test_as_a_user_meets_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        daylit.main(["dataset", "build", str(folder), "--name", "n", "--licence", "CC0-1.0", "--split", "0,50,50"]) == 0
    )
    assert "sessions           4" in capsys.readouterr().out
    assert daylit.main(["dataset", "check", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True
    assert daylit.main(["dataset", "summary", str(folder), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["sessions"], found["rooms"], found["splits"]["train"]) == (4, 3, 0)
    (folder / "0-kitchen" / "session.json").write_text("{}")
    assert daylit.main(["dataset", "check", str(folder)]) == 1
    assert "changed: 0-kitchen/session.json" in capsys.readouterr().out
    assert daylit.main(["dataset", "build", str(folder), "--name", "n", "--licence", "x", "--split", "a"]) == 2
