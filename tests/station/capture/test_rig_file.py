"""rig.toml: the example is valid, and what is wrong is named."""

from __future__ import annotations

import math
import os
from pathlib import Path

import pytest

from station.capture.bracket import PAPER_STOPS_S
from station.capture.rig import SIZE_STEPS, find_rig_file, planned_times_s, simulated_rig_file
from station.capture.rig_file import PAPER_RIG, example_text, load_rig
from station.errors import RigError
from station.session.session import Side, Site


def write(folder: Path, text: str) -> Path:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_example_is_the_papers_rig(tmp_path: Path) -> None:
    rig = load_rig(write(tmp_path, example_text()))
    assert load_rig(write(tmp_path, "\ufeff" + example_text().replace("\n", "\r\n"))) == rig, "saved on Windows"
    assert rig.bracket.stops_s() == PAPER_STOPS_S
    assert rig.indoor == PAPER_RIG.indoor
    assert rig.outdoor == PAPER_RIG.outdoor
    assert rig.meter is not None
    assert rig.meter.target() is not None
    assert not rig.meter.is_read, "no dialect of the LS-160 is confirmed: its readings are typed in"


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[indoor]\nkind = 'gopro'\niso = 100\nf_number = 2\nsize_px = [1, 2]", "indoor.kind"),
        ("[indoor]\nkind = 'theta_z1'\niso = 100\nf_number = 5.6\nsize_px = [6720, 3360]\nflash = true", "flash"),
        (
            "[indoor]\nkind = 'theta_z1'\niso = 100\nf_number = 5.6\nsize_px = [6720, 3360]\ndestination = 'pc'",
            "only canon_5d2 has this key",
        ),
        ("[bracket]\nstops = ['4', 'long']", "bracket"),
        ("[meter]\ntarget_deg = [500, 0]", "target_deg"),
        ("[meter]\nport = '/dev/ttyACM0'", "no dialect"),
        ("heading_deg = nan", "heading_deg"),
        ("this is not toml", "rig.toml"),
        ("[limits]\nmin_battery_frac = 2", "min_battery_frac"),
        (
            "[outdoor]\nkind = 'canon_5d2'\niso = 200\nf_number = 16\nsize_px = [5616, 3744]\n"
            "image_circle = [2808, 1872, 1763]",  # pixels
            "outdoor.image_circle.0",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(RigError, match=r"rig\.toml") as caught:
        load_rig(write(tmp_path, text))
    assert named in str(caught.value)


def test_missing_and_oversized_files(tmp_path: Path) -> None:
    with pytest.raises(RigError, match="no such rig file"):
        load_rig(tmp_path / "none.toml")
    with pytest.raises(RigError, match="too large"):
        load_rig(write(tmp_path, "#" * 300_000))
    for endless in ("/dev/zero", "/dev/urandom"):
        with pytest.raises(RigError, match="no regular file"):
            load_rig(Path(endless))
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RigError, match="no regular file"):
        load_rig(tmp_path / "pipe")


def test_target_is_in_radians(tmp_path: Path) -> None:
    rig = load_rig(write(tmp_path, "[meter]\ntarget_deg = [-90, 30]"))
    target = rig.meter.target()  # type: ignore[union-attr]
    assert target is not None
    assert target.longitude_rad == pytest.approx(-math.pi / 2)
    assert target.latitude_rad == pytest.approx(math.pi / 6)


def test_no_rig_file_says_how_to_get_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    with pytest.raises(RigError, match="--write-rig"):
        find_rig_file(None)


@pytest.mark.parametrize("size", SIZE_STEPS)
def test_simulated_sizes_are_even_and_keep_shape(size: str) -> None:
    for table in simulated_rig_file(PAPER_RIG, size).cameras().values():
        width_px, height_px = table.size_px
        assert width_px % 2 == height_px % 2 == 0
        assert width_px / height_px == pytest.approx({"theta_z1": 2.0, "canon_5d2": 1.5}[table.kind], rel=0.02)
    assert set(PAPER_RIG.cameras()) == set(Side)


def test_stops_are_planned_one_after_another_from_the_first_reading_on() -> None:
    """Short to long: the first begins after preflight and reading, each next one when the slower camera is done."""
    times_s = planned_times_s(PAPER_RIG)
    assert set(times_s) == {"theta_z1", "canon_5d2"}
    by_stop = dict(zip(PAPER_RIG.bracket.stops_s(), times_s["theta_z1"], strict=True))
    assert by_stop[1 / 8000] == 6.0
    assert by_stop[1 / 4000] - by_stop[1 / 8000] == pytest.approx(2.75 + 1 / 8000)
    assert by_stop[4.0] - by_stop[1.0] == pytest.approx(2.75 + 1.0)
    assert times_s["canon_5d2"] == times_s["theta_z1"]
    without_meter = planned_times_s(PAPER_RIG.model_copy(update={"meter": None}))
    assert min(without_meter["theta_z1"]) == 1.0


def test_a_simulated_rig_stands_where_its_generated_room_does() -> None:
    from mocks.rooms.room import make_room
    from station.capture.rig import _place_of

    room = make_room(7, "bedroom")
    tables, begins_utc = _place_of("bedroom-7")
    assert begins_utc == room.moment.utc
    assert tables["camera_height_m"] == room.plan.camera_height_m
    assert tables["heading_deg"] == pytest.approx(math.degrees(room.moment.heading_rad), abs=1e-4)
    assert tables["site"] == Site(latitude_deg=room.moment.latitude_deg, longitude_deg=room.moment.longitude_deg)
    assert _place_of("room") == ({}, None)


def test_shutters_of_a_simulation_faster_than_life_may_part_by_as_much_more() -> None:
    from station.capture.rig import open_named_rig
    from station.capture.rig_file import LimitsTable

    for rate in (1.0, 8.0):
        rig = open_named_rig(None, "uniform:100", size="small", rate=rate)
        rig.close()
        assert rig.file.limits.max_start_skew_s == rate * LimitsTable().max_start_skew_s
