"""Conditions: the paper's list is read as it is, and what is wrong is named by line and column."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.shared_data import DATA
from station.errors import ConditionsError
from station.simulate.conditions import COLUMNS, load_conditions, orientation

HEADER = ",".join(COLUMNS)
GOOD = "56,20230519,coda_320,15:54,73.25,15:52,51600,261°W,YES,YES"
PAPER = "paper/cali_hdr_summary.csv"


def written(tmp_path: Path, *rows: str, header: str = HEADER, encoding: str = "utf-8") -> Path:
    path = tmp_path / "conditions.csv"
    path.write_text("\n".join((header, *rows)) + "\n", encoding)
    return path


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_a_row_says_where_when_and_under_what_light(tmp_path: Path, encoding: str) -> None:
    (condition,) = load_conditions(written(tmp_path, GOOD, encoding=encoding))
    assert (condition.index, condition.scene, condition.line) == (56, "coda_320", 2)
    assert condition.local == datetime(2023, 5, 19, 15, 54)
    assert condition.outdoor_local == datetime(2023, 5, 19, 15, 52)
    assert (condition.luminance_cd_m2, condition.illuminance_lux) == (73.25, 51600)
    assert condition.heading_deg == 261
    assert condition.nd_filter
    assert not condition.lamps_on


def test_indoor_only_with_lamps_and_one_digit_hours(tmp_path: Path) -> None:
    (condition,) = load_conditions(written(tmp_path, "109,20230630,garden,9:23,,,,239°SW,,With electrical light"))
    assert condition.local == datetime(2023, 6, 30, 9, 23)
    assert condition.outdoor_local is None
    assert condition.illuminance_lux is None
    assert condition.lamps_on
    assert not condition.nd_filter


def test_columns_may_be_in_any_order_with_others_between(tmp_path: Path) -> None:
    cells = dict(zip(COLUMNS, GOOD.split(","), strict=True)) | {"note": '"bright, warm"'}
    names = sorted(cells)
    path = written(tmp_path, ",".join(cells[n] for n in names), "", header=",".join(names))
    assert load_conditions(path)[0].scene == "coda_320"


@pytest.mark.parametrize(
    ("column", "cell", "result"),
    [
        ("index", "one", "not a number"),
        ("date", "2023-05-19", "not a date such as"),
        ("date", "20230229", "not a date: day"),
        ("theta_time", "24:00", "not a time such as"),
        ("theta_time", "9.23", "not a time such as"),
        ("theta_time", "", "not a time such as"),
        ("fisheye_time", "9:7", "not a time such as"),
        ("scene_name", "", "not a name"),
        ("scene_name", "///", "no letter or digit"),
        ("scene_name", "a" * 61, "not a name"),
        ("luminance_cd_m2", "-3", "not a number above 0"),
        ("luminance_cd_m2", "nan", "not a number above 0"),
        ("illuminance_lux", "0", "not a number above 0"),
        ("illuminance_lux", "1e999", "not a number above 0"),
        ("orientation", "261", "not a direction such as"),
        ("orientation", "400°W", "not a direction such as"),
        ("orientation", "261°E", "is not E but 261°W"),
        ("orientation", "10°NN", "not a point of the compass"),
        ("nd_filter", "yes", "none of"),
        ("nd_filter", "", "though the sky was photographed"),
        ("natural_light", "", "none of"),
    ],
)
def test_a_bad_cell_is_named(tmp_path: Path, column: str, cell: str, result: str) -> None:
    cells = dict(zip(COLUMNS, GOOD.split(","), strict=True)) | {column: cell}
    path = written(tmp_path, "1,20230519,room,12:00,,,,0°N,,YES", ",".join(cells.values()))
    with pytest.raises(ConditionsError) as caught:
        load_conditions(path)
    assert str(path) in str(caught.value)
    assert f"line 3, column {column}: " in str(caught.value)
    assert result in str(caught.value)
    assert caught.value.code == "USE-003"


def test_all_faults_are_reported_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConditionsError) as caught:
        load_conditions(written(tmp_path, GOOD.replace("15:54", "x"), GOOD.replace("261°W", "y"), GOOD, GOOD))
    faults = caught.value.details["faults"]
    assert [f.split(":")[0] for f in faults] == [
        "line 2, column theta_time",
        "line 3, column orientation",
        "line 5, column index",
    ]


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ("", "needs each of these columns once"),
        (HEADER.replace("orientation", "heading"), "once: orientation"),
        (f"{HEADER},index\n{GOOD},1", "once: index"),
        (HEADER, "it lists no sessions"),
        (f"{HEADER}\n{GOOD},1", "line 2: 11 cells under 10 columns"),
        (f'{HEADER}\n"{GOOD}', "line 2: "),
    ],
)
def test_a_file_that_is_no_list_is_refused(tmp_path: Path, text: str, result: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(text, "utf-8")
    with pytest.raises(ConditionsError, match=result):
        load_conditions(path)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConditionsError, match="no such file"):
        load_conditions(tmp_path / "none.csv")
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConditionsError, match="cannot be read"):
        load_conditions(tmp_path / "c.csv")
    with pytest.raises(ConditionsError, match="cannot be read"):
        load_conditions(tmp_path)


@given(st.floats(0, 360, exclude_max=True))
def test_an_orientation_that_was_written_can_be_read(heading_deg: float) -> None:
    from station.simulate.conditions import _heading

    off_deg = (_heading(orientation(heading_deg)) - heading_deg + 180) % 360 - 180
    assert abs(off_deg) <= 0.5


@pytest.mark.shared(PAPER)
def test_the_papers_list_has_137_conditions() -> None:
    conditions = load_conditions(DATA / PAPER)
    assert len(conditions) == 137
    assert [c.index for c in conditions] == list(range(1, 138))
    assert sum(c.outdoor_local is None for c in conditions) == 24
    assert {c.heading_deg for c in conditions if c.scene == "coda_334"} == {167.0}
    assert sum(c.lamps_on for c in conditions) == 6
