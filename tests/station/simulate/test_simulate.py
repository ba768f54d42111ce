"""Data sets: sessions as the station captures them, at the times and headings asked for; begun again where it ended."""

from __future__ import annotations

import csv
import json
import math
import shutil
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import daylit
from benchmarks.truth_files import load_truth
from drivers.errors import DeviceTimeoutError
from mocks.rooms import truth as truth_of_rooms
from mocks.rooms.light import light
from mocks.rooms.room import make_room
from mocks.rooms.sky import backdrop
from mocks.worlds.simple_room import SimpleRoom
from station.capture.rig import SIZE_STEPS
from station.errors import ConditionsError, SessionExistsError
from station.session.manifest import load_manifest
from station.session.session import SessionManifest, SessionStatus, Side
from station.session.verify import verify_session
from station.simulate import run
from station.simulate.conditions import COLUMNS, load_conditions
from station.simulate.plan import LEDGER_COLUMNS, SITE_DEG, DatasetRequest, Planned, plan_sessions
from station.simulate.run import DatasetEvent, Summary, simulate

ROWS = (
    "4,20221006,1f_bed,13:33,47.70,13:35,,328°NW,YES,YES",
    "120,20230115,coda_320,9:23,14.57,9:27,23260,97°E,NO,YES",
    "108,20230630,ruth_garden,9:20,21.02,,,239°SW,,With electrical light",
)
NAMES = ("2022-10-06T1733Z_1f-bed", "2023-01-15T1423Z_coda-320", "2023-06-30T1320Z_ruth-garden")
"""By UTC: summer time in October and June, none in January."""


def no_baking(_plan: Planned, _request: DatasetRequest) -> SimpleRoom:
    """Cameras look at the built-in room, which needs no light baked; everything else is as ever."""
    return SimpleRoom()


@pytest.fixture(scope="module", autouse=True)
def coarse_skyline() -> Iterator[None]:
    """A skyline of an eighth the columns, as tests of rooms have it: nobody looks at what stands before windows.

    Nor at much in the frames: small ones are half as wide.
    """
    with pytest.MonkeyPatch.context() as context:
        context.setitem(SIZE_STEPS, "small", 32)
        context.setattr(backdrop, "COLUMNS", 512)
        context.setattr(backdrop, "PIXEL_RAD", 2 * math.pi / 512)
        context.setattr(backdrop, "ROWS", round((backdrop.TOP_RAD - backdrop.BOTTOM_RAD) / backdrop.PIXEL_RAD))
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Summary]:
    """A data set of three sessions; tests leave it as it is."""
    folder = tmp_path_factory.mktemp("data")
    with pytest.MonkeyPatch.context() as context:
        context.setattr(run, "room_world", no_baking)
        return folder, simulate(request(folder))


@pytest.fixture
def copied(made: tuple[Path, Summary], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, to change."""
    monkeypatch.setattr(run, "room_world", no_baking)
    shutil.copytree(made[0], tmp_path, dirs_exist_ok=True)
    return tmp_path


def request(folder: Path, *rows: str, **options: object) -> DatasetRequest:
    path = folder / "conditions.csv"
    path.write_text("\n".join((",".join(COLUMNS), *(rows or ROWS))), "utf-8")
    defaults = {"size": "small", "quality": "draft", "truth": False, "clock_rate": 20.0}
    return DatasetRequest(folder / "set", path, **(defaults | options))


def ledger(folder: Path) -> list[dict[str, str]]:
    with (folder / "set" / "dataset.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_sessions_are_whole_and_say_when_where_and_whither(made: tuple[Path, Summary]) -> None:
    folder, summary = made
    assert (summary.made, summary.kept, summary.failed) == (list(NAMES), [], {})
    conditions = load_conditions(folder / "conditions.csv")
    for name, condition in zip(NAMES, conditions, strict=True):
        report = verify_session(folder / "set" / name)
        assert report.intact, report.problems
        manifest = load_manifest(folder / "set" / name)
        assert manifest.status is SessionStatus.COMPLETE
        assert manifest.name == condition.scene
        start = datetime.strptime(name[:15], "%Y-%m-%dT%H%M").replace(tzinfo=UTC)
        for moment in (manifest.created_utc, *(r.taken_utc for r in manifest.readings)):
            assert timedelta() <= moment - start < timedelta(minutes=10)
        assert (manifest.site.latitude_deg, manifest.site.longitude_deg) == SITE_DEG
        assert manifest.heading_rad == pytest.approx(math.radians(condition.heading_deg), abs=1e-5)
        sides = {Side.INDOOR, Side.OUTDOOR} if condition.outdoor_local else {Side.INDOOR}
        assert set(manifest.bracket.sides) == sides
        assert len(manifest.frames) == 9 * len(sides)
    assert load_manifest(folder / "set" / NAMES[0]).rig["outdoor"]["nd_filter"] == "ND 3.0"
    assert load_manifest(folder / "set" / NAMES[1]).rig["outdoor"]["nd_filter"] == ""
    assert not (folder / "set" / ".unfinished").exists()


def test_without_its_filter_the_outdoor_camera_gets_a_thousand_times_the_light(made: tuple[Path, Summary]) -> None:
    """1/8000 s with ND 3.0 is nearly black; without, it is brighter than 1/15 s with it."""
    means = {}
    for name in NAMES[:2]:
        frames = [f for f in load_manifest(made[0] / "set" / name).frames if f.side is Side.OUTDOOR]
        means[name] = [f.statistics.mean_frac for f in sorted(frames, key=lambda f: f.stop) if f.statistics]
    with_filter, without = means[NAMES[0]], means[NAMES[1]]
    assert len(with_filter) == len(without) == 9
    assert without[8] > with_filter[4]


def test_the_list_of_what_is_there_has_the_columns_of_the_conditions(made: tuple[Path, Summary]) -> None:
    rows = ledger(made[0])
    assert tuple(rows[0]) == LEDGER_COLUMNS
    assert [r["session"] for r in rows] == [NAMES[0], NAMES[2], NAMES[1]], "by index"
    again = {c.index: c for c in load_conditions(made[0] / "set" / "dataset.csv")}
    wanted = load_conditions(made[0] / "conditions.csv")
    assert len(wanted) == len(again) == 3
    for asked in wanted:
        found = again[asked.index]
        for same in ("scene", "local", "outdoor_local", "heading_deg", "nd_filter", "lamps_on"):
            assert getattr(found, same) == getattr(asked, same)
        assert found.luminance_cd_m2 is not None, "as the simulated meter read it"
    assert rows[0]["room"] == f"bedroom-{rows[0]['room_seed']}"
    assert [r["utc"][:16] for r in rows] == ["2022-10-06T17:33", "2023-06-30T13:20", "2023-01-15T14:23"]


def test_what_is_complete_is_kept_and_the_rest_made(copied: Path) -> None:
    shutil.rmtree(copied / "set" / NAMES[2])
    before = (copied / "set" / NAMES[0] / "session.json").stat().st_mtime_ns
    left = copied / "set" / ".unfinished" / "half"
    left.mkdir(parents=True)
    events: list[DatasetEvent] = []
    summary = simulate(request(copied), events.append)
    assert (summary.kept, summary.made) == (list(NAMES[:2]), [NAMES[2]])
    assert (copied / "set" / NAMES[0] / "session.json").stat().st_mtime_ns == before
    assert not left.exists()
    assert [e.kind for e in events if e.session == NAMES[0]] == ["begun", "kept"]
    assert len(ledger(copied)) == 3


def test_another_kind_of_session_is_not_mixed_in(copied: Path) -> None:
    with pytest.raises(SessionExistsError, match="size small, not quarter"):
        simulate(request(copied, size="quarter"))
    with pytest.raises(SessionExistsError, match="seed 0, not 1"):
        simulate(request(copied, seed=1))
    summary = simulate(request(copied, ROWS[0].replace("328°NW", "59°NE")))
    assert summary.failed[NAMES[0]]["code"] == SessionExistsError.code


def test_two_sessions_of_one_minute_have_two_folders(tmp_path: Path) -> None:
    drafts = plan_sessions(request(tmp_path, ROWS[2], ROWS[2].replace("108", "109")))
    assert [d.name for d in drafts] == [NAMES[2], f"{NAMES[2]}-2"]
    assert [d.build().folder for d in drafts] == [NAMES[2], f"{NAMES[2]}-2"]


def test_rooms_by_seed_have_their_own_places_and_times(tmp_path: Path) -> None:
    drafts = plan_sessions(DatasetRequest(tmp_path, sessions=3, seed=7, use="office"))
    for seed, plan in zip((7, 8, 9), (d.build() for d in drafts), strict=True):
        room = make_room(seed, "office")
        assert plan.room == room
        assert plan.folder == f"{room.moment.utc:%Y-%m-%dT%H%MZ}_office-{seed}"
        assert plan.heading_deg == pytest.approx(math.degrees(room.moment.heading_rad))
        off = plan.local.utcoffset()
        assert off is not None
        assert abs(off / timedelta(hours=1) - room.moment.longitude_deg / 15) <= 0.5


def test_one_that_fails_is_reported_and_the_next_run_makes_it(
    copied: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_plan: Planned, _request: DatasetRequest) -> SimpleRoom:
        raise RuntimeError("no such light")

    shutil.rmtree(copied / "set" / NAMES[2])
    asked = request(copied)
    arguments = ["simulate", str(asked.into), "--conditions", str(asked.conditions), "--size", "small", "--no-truth"]
    arguments += ["--quality", "draft"]
    monkeypatch.setattr(run, "room_world", broken)
    assert daylit.main([*arguments, "--json"]) == 4
    result = json.loads(capsys.readouterr().out)
    assert (result["ok"], result["kept"]) == (False, list(NAMES[:2]))
    assert [f["session"] for f in result["failed"]] == [NAMES[2]]
    assert "no such light" in result["failed"][0]["message"]
    monkeypatch.setattr(run, "room_world", no_baking)
    assert daylit.main(arguments) == 0
    assert "3 sessions" in capsys.readouterr().out


@pytest.mark.parametrize("n_slow", [1, 3])
def test_what_a_busy_computer_spoils_is_taken_anew(copied: Path, monkeypatch: pytest.MonkeyPatch, n_slow: int) -> None:
    rates: list[float] = []

    def spoiled(_plan: object, _request: object, rate: float, _progress: object) -> tuple[SessionManifest, Path]:
        rates.append(rate)
        if len(rates) <= n_slow:
            raise DeviceTimeoutError("no answer")
        path = copied / "taken"
        shutil.copytree(copied / "set" / NAMES[0], path)
        # The copy may itself have been taken on a busy computer: only the rates asked for are of interest here.
        return load_manifest(path).model_copy(update={"warnings": []}), path

    monkeypatch.setattr(run, "_take", spoiled)
    shutil.rmtree(copied / "set" / NAMES[2])
    summary = simulate(request(copied, ROWS[2]))
    assert rates == [20.0, 10.0, 4.0][: n_slow + 1]
    assert (summary.made == [NAMES[2]]) == (n_slow < 3)
    assert (NAMES[2] in summary.failed) == (n_slow == 3)


def test_a_session_at_night_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    with pytest.raises(ConditionsError, match="line 2, column theta_time: the sun is down"):
        simulate(request(tmp_path, ROWS[0].replace("13:33", "23:33")))
    assert not (tmp_path / "set").exists()


def test_a_generated_room_with_its_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The meter reads, and the truth says, the same luminance."""
    monkeypatch.setitem(light.QUALITIES, "draft", light.Quality(24, 16))
    monkeypatch.setattr(light, "ENVIRONMENT_ROWS", 32)
    monkeypatch.setattr(truth_of_rooms, "point_lights", partial(truth_of_rooms.point_lights, samples=64))
    name, row = "2023-06-22T1058Z_coda-334", "90,20230622,coda_334,6:58,4.47,,2116,167°S,,YES"
    asked = request(tmp_path, row, truth=True, truth_rows=64, use="empty")
    summary = simulate(asked)
    assert summary.made == [name]
    manifest = load_manifest(tmp_path / "set" / name)
    truth = load_truth(tmp_path / "set" / "truth" / name)
    assert truth.facts["name"] == ledger(tmp_path)[0]["room"]
    assert truth.facts["sky"]["kind"] == "overcast"
    assert truth.facts["moment"]["utc"] == "2023-06-22T10:58:00+00:00"
    azimuth_rad = truth.facts["sky"]["sun_azimuth_rad"] + truth.facts["moment"]["heading_rad"]
    assert math.degrees(azimuth_rad) % 360 == pytest.approx(68, abs=5), "on a June morning"
    assert truth.pictures.luminance_rgb.shape == (64, 128, 3)
    assert not truth.pictures.furniture.any()
    assert manifest.target is not None
    column = int((manifest.target.longitude_rad / (2 * math.pi) + 0.5) * 128)
    row = int((0.5 - manifest.target.latitude_rad / math.pi) * 64)
    seen = truth.pictures.luminance_rgb[row, column] @ np.array([0.2127, 0.7151, 0.0722])
    readings = [r.luminance_cd_m2 for r in manifest.readings if r.luminance_cd_m2 is not None]
    assert readings == pytest.approx([seen, seen], rel=0.15)
    assert simulate(asked).kept == [name], "and the truth is not made twice"
