"""Trees laid out as the authors' own data, through ``daylit import --dataset``, ``verify`` and ``process``."""

from __future__ import annotations

import hashlib
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

import daylit
from station.session.session import SessionManifest, Side
from station.session.store import load_manifest
from tests.station.frames.pictures import cr2, dng, jpeg

STOPS_S = (4.0, 1.0, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000)
THETA = {"MAKE": "RICOH", "MODEL": "RICOH THETA Z1", "size": (160, 80), "SERIAL": None}
HEAD = "index,date,scene_name,theta_time,luminance_cd_m2,fisheye_time,illuminance_lux,"
HEAD += "orientation,nd_filter,natural_light\n"


def theta(
    folder: Path, taken: datetime, *, first: int = 926, with_exif: bool = True, seed: int = 1, raw: bool = True
) -> None:
    """Write nine JPEGs and DNGs, 6.5 s a frame, as the Theta names them."""
    folder.mkdir(parents=True, exist_ok=True)
    for i, time_s in enumerate(STOPS_S):
        stamp = f"{taken + timedelta(seconds=6.5 * i):%Y:%m:%d %H:%M:%S}"
        picture = jpeg(
            time_s,
            seed=seed,
            with_exif=with_exif,
            **({**THETA, "TAKEN_TAG": stamp} if with_exif else {"size": (160, 80)}),
        )
        (folder / f"R{first + i:07d}.JPG").write_bytes(picture)
        if raw:
            (folder / f"R{first + i:07d}.DNG").write_bytes(dng(time_s, TAKEN_TAG=stamp))


def canon(folder: Path, taken: datetime, *, first: int = 5956, seed: int = 3) -> None:
    """Write nine JPEGs and CR2s as the 5D Mark II names them, all within ten seconds."""
    folder.mkdir(parents=True, exist_ok=True)
    for i, time_s in enumerate(STOPS_S):
        stamp = f"{taken + timedelta(seconds=i):%Y:%m:%d %H:%M:%S}"
        (folder / f"IMG_{first + i}.JPG").write_bytes(jpeg(time_s, seed=seed, ISO=200, F_NUMBER=16.0, TAKEN_TAG=stamp))
        (folder / f"IMG_{first + i}.CR2").write_bytes(cr2())


def run(capsys: pytest.CaptureFixture[str], tmp_path: Path, *options: str) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    command = [
        "import",
        "--dataset",
        str(tmp_path / "Cali-HDR Dataset"),
        "--into",
        str(tmp_path / "sessions"),
        "--json",
    ]
    code = daylit.main([*command, *options])
    return code, json.loads(capsys.readouterr().out)


def manifests(answer: dict[str, Any]) -> dict[str, SessionManifest]:
    return {one["name"]: load_manifest(Path(one["session"])) for one in answer["brackets"] if "session" in one}


def digests(root: Path) -> dict[str, str]:
    return {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(root.rglob("*")) if p.is_file()}


def test_a_day_of_cali_hdr(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two brackets a day and a sky each, raw files beside them, a table with readings; to the merged pictures."""
    root = tmp_path / "Cali-HDR Dataset"
    day = datetime(2023, 5, 21)
    theta(root / "20230521/pano/coda320_16:56", day.replace(hour=16, minute=55, second=52))
    theta(root / "20230521/pano/coda320_15:59", day.replace(hour=15, minute=58, second=59), first=912, seed=5)
    canon(root / "20230521/fisheye/coda320_16:53", day.replace(hour=16, minute=54, second=37))
    canon(root / "20230521/fisheye/coda320_15:56", day.replace(hour=15, minute=58, second=19), first=5947, seed=7)
    (root / "20230521/pano/.idea").mkdir()
    (root / "20230521/pano/.idea/workspace.xml").write_text("<xml/>")
    table = tmp_path / "summary.csv"
    table.write_text(
        HEAD
        + "1,20230521,coda_320,16:56,34.63,16:53,28250,261°W,YES,YES\n"
        + "2,20230521,coda_320,15:59,165.7,15:56,,261°W,NO,With electrical light\n"
        + "3,20230521,coda_320,9:59,1.0,9:56,,261°W,YES,YES\n"
    )
    before = digests(root)
    options = ("--table", str(table), "--zone", "America/New_York", "--site", "40.44,-79.99")
    code, answer = run(capsys, tmp_path, *options)
    assert (code, answer["ok"]) == (0, True)
    assert digests(root) == before, "the folders stay as they are"
    assert answer["table_lines_unused"] == [4]
    found = manifests(answer)
    assert set(found) == {"2023-05-21 coda320 16:56", "2023-05-21 coda320 15:59"}
    one = found["2023-05-21 coda320 16:56"]
    assert one.status == "complete"
    assert [(f.side, f.format) for f in one.frames].count((Side.INDOOR, "dng")) == 9
    assert [(f.side, f.format) for f in one.frames].count((Side.OUTDOOR, "cr2")) == 9
    assert one.bracket.raw_sides == (Side.INDOOR, Side.OUTDOOR)
    assert [r.luminance_cd_m2 for r in one.readings] == [34.63]
    kinds = {d.role: (d.kind, d.nd_filter) for d in one.devices}
    assert kinds == {"indoor": ("theta_z1", ""), "outdoor": ("canon_5d2", "ND 3.0")}
    assert {d.nd_filter for d in found["2023-05-21 coda320 15:59"].devices} == {""}
    assert one.frames[0].taken_utc == datetime(2023, 5, 21, 20, 55, 52, tzinfo=UTC), "summer time"
    texts = [w.message for w in one.warnings]
    assert "the sky was taken 3 minutes earlier than the room" in texts
    assert any("--outdoor-lux 28250" in text for text in texts)

    for path in (one["session"] for one in answer["brackets"]):
        assert daylit.main(["verify", path, "--look"]) == 0
    session = next(b["session"] for b in answer["brackets"] if b["name"].endswith("16:56"))
    assert daylit.main(["process", session, "--until", "merge", "--json"]) in (0, None)

    code, answer = run(capsys, tmp_path, *options)
    assert code == 0
    assert [b["there"] for b in answer["brackets"]] == [True, True], "what is there is not made again"


def test_pano2pano_has_a_panorama_behind_the_glass_for_a_sky(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "Cali-HDR Dataset" / "Pano2Pano_Release"
    day = datetime(2024, 3, 26)
    theta(root / "20240326/city apt/indoor/1354_living", day.replace(hour=13, minute=54))
    theta(root / "20240326/city apt/indoor/1355_living", day.replace(hour=13, minute=56), first=950, seed=4)
    theta(root / "20240326/city apt/outdoor/1350_Living", day.replace(hour=13, minute=50), first=900, seed=9)
    code, answer = run(capsys, tmp_path)
    assert code == 0
    found = manifests(answer)
    assert set(found) == {"2024-03-26 city apt living 13:54", "2024-03-26 city apt living 13:55"}
    for manifest in found.values():
        assert {d.role: d.kind for d in manifest.devices} == {"indoor": "theta_z1", "outdoor": "theta_z1"}
        assert manifest.bracket.sides == (Side.INDOOR, Side.OUTDOOR)
    session = answer["brackets"][0]["session"]
    assert daylit.main(["verify", session]) == 0
    assert daylit.main(["process", session, "--until", "merge"]) in (0, None)


def test_a_bracket_that_lost_its_exif(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From the DNGs where they are; from --shutter else; and refused by name without either."""
    root = tmp_path / "Cali-HDR Dataset"
    day = datetime(2022, 10, 6, 13, 33)
    theta(root / "20221006/theta/1f_bed_13:33", day, first=153, with_exif=False)
    theta(
        root / "20221006/theta/1f_kitchen_13:15", day.replace(minute=15), first=120, with_exif=False, raw=False, seed=2
    )
    code, answer = run(capsys, tmp_path)
    assert code == 4
    by_name = {one["name"]: one for one in answer["brackets"]}
    assert by_name["2022-10-06 1f_bed 13:33"]["frames"] == 18
    error = by_name["2022-10-06 1f_kitchen 13:15"]["error"]
    assert error["code"] == "SES-009"
    assert "R0000120.JPG" in json.dumps(error)
    assert "--shutter" in json.dumps(error)
    manifest = manifests(answer)["2022-10-06 1f_bed 13:33"]
    assert [f.camera_s for f in manifest.frames if f.format == "jpeg"] == pytest.approx(STOPS_S)
    assert (manifest.devices[0].model, manifest.frames[0].iso) == ("RICOH THETA Z1", 100)
    assert any("the raw file's is used" in w.message for w in manifest.warnings)

    code, answer = run(
        capsys, tmp_path, "--shutter", "4,1,1/4,1/15,1/60,1/250,1/1000,1/4000,1/8000", "--only", "kitchen"
    )
    assert code == 0
    assert [one["frames"] for one in answer["brackets"]] == [9]


def test_folders_without_a_date_take_the_zone_by_their_frames_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "Cali-HDR Dataset"
    theta(root / "summer/pano/kitchen", datetime(2023, 5, 21, 16, 0), raw=False)
    theta(root / "winter/pano/bath", datetime(2023, 12, 21, 16, 0), raw=False, seed=5)
    _, answer = run(capsys, tmp_path, "--zone", "America/New_York")
    taken = {m.frames[0].taken_utc for m in manifests(answer).values()}
    assert taken == {datetime(2023, 5, 21, 20, 0, tzinfo=UTC), datetime(2023, 12, 21, 21, 0, tzinfo=UTC)}


def test_two_visits_to_a_room_of_one_name_are_two_sessions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "Cali-HDR Dataset"
    theta(root / "pano/kitchen", datetime(2023, 5, 21, 16, 0), raw=False)
    _, answer = run(capsys, tmp_path)
    assert len(manifests(answer)) == 1
    (root / "pano/kitchen").rename(tmp_path / "first visit")
    theta(root / "pano/kitchen", datetime(2023, 6, 21, 16, 0), raw=False, seed=5)
    _, answer = run(capsys, tmp_path)
    (second,) = manifests(answer).values()
    assert second.frames[0].sha256 == hashlib.sha256((root / "pano/kitchen/R0000926.JPG").read_bytes()).hexdigest()
    _, answer = run(capsys, tmp_path)
    assert not manifests(answer), "and both are there now"


def test_several_brackets_in_one_folder_are_parted_where_a_stop_comes_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "Cali-HDR Dataset"
    day = datetime(2023, 5, 28, 10, 0)
    theta(root / "20230528/theta/coda_334", day, first=1)
    theta(root / "20230528/theta/coda_334", day.replace(hour=11), first=10, seed=6)
    canon(root / "20230528/fisheye/coda_334_10:58", day.replace(hour=10, minute=59))
    code, answer = run(capsys, tmp_path)
    assert code == 0
    found = manifests(answer)
    assert set(found) == {"2023-05-28 coda_334 10:00 part 1", "2023-05-28 coda_334 11:00 part 2"}
    assert found["2023-05-28 coda_334 10:00 part 1"].bracket.sides == (Side.INDOOR,)
    assert found["2023-05-28 coda_334 11:00 part 2"].bracket.sides == (Side.INDOOR, Side.OUTDOOR)
    names = [f.camera_name for m in found.values() for f in m.frames if f.side is Side.INDOOR and f.format == "jpeg"]
    assert sorted(names) == [f"R{i:07d}.JPG" for i in range(1, 19)], "each once"


def test_what_is_not_decided_is_named_and_the_rest_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "Cali-HDR Dataset"
    day = datetime(2023, 5, 21, 10, 0)
    theta(root / "20230521/pano/coda320_10:00", day, raw=False)
    canon(root / "20230521/fisheye/coda320_09:58", day.replace(hour=9, minute=58))
    canon(root / "20230521/fisheye/coda320_10:02", day, first=6100, seed=8)
    theta(root / "20230521/attic_12:00", day.replace(hour=12), first=300, seed=2, raw=False)
    theta(root / "20230521/pano/bath_12:30", day.replace(hour=12, minute=30), first=400, seed=11, raw=False)
    code, answer = run(capsys, tmp_path)
    assert code == 4
    assert set(manifests(answer)) == {"2023-05-21 bath 12:30"}
    doubted = {path.rpartition("20230521/")[2] for doubt in answer["doubts"] for path in doubt["paths"]}
    assert doubted == {"attic_12:00", "pano/coda320_10:00", "fisheye/coda320_09:58", "fisheye/coda320_10:02"}
    code, answer = run(capsys, tmp_path, "--strict")
    assert (code, answer["error"]["code"]) == (4, "SES-010")
    code, answer = run(capsys, tmp_path, "--dry-run")
    assert (code, [b["name"] for b in answer["brackets"]]) == (4, ["2023-05-21 bath 12:30"])


def test_a_dry_run_names_every_bracket_with_its_folders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "Cali-HDR Dataset" / "20230521"
    for name in ("pano/bath_10:00", "pano/hall_11:00", "fisheye/hall_11:01"):
        (root / name).mkdir(parents=True)
        (root / name / "R0000001.JPG").write_bytes(b"")
    (imported := root / "sessions" / "2023-05-21T1000Z_attic" / "indoor").mkdir(parents=True)
    (imported / "00_4s.jpg").write_bytes(b"")
    (imported.parent / "session.json").write_text("{}")
    assert daylit.main(["import", "--dataset", str(root.parent), "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "attic" not in said, "what was imported already is not imported again"
    assert "bath 10:00: indoor bath_10:00 (1 files)" in said
    assert "hall 11:00: indoor hall_11:00 (1 files) + outdoor hall_11:01 (1 files)" in said


def test_raw_files_without_wells_are_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "Cali-HDR Dataset" / "20230521/pano/coda320_10:00"
    theta(root, datetime(2023, 5, 21, 10))
    for path in root.glob("*.JPG"):
        path.unlink()
    code, answer = run(capsys, tmp_path)
    assert code == 4
    refused = json.dumps(answer["brackets"][0]["error"])
    assert "R0000926.DNG" in refused
    assert "its wells cannot be read" in refused


@pytest.mark.parametrize(
    "options",
    [["--zone", "Mars/Olympus"], ["--reading", "3"], ["--target", "0,0"], ["--table", "none.csv"]],
)
def test_options_that_cannot_be_right(tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str]) -> None:
    (tmp_path / "Cali-HDR Dataset").mkdir()
    code, answer = run(capsys, tmp_path, *options)
    assert (code, answer["error"]["code"]) == (2, "USE-001")
    assert daylit.main(["import", "room", "--only", "x", "--json"]) == 2
    assert daylit.main(["import", "--json"]) == 2


def test_an_empty_tree_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "Cali-HDR Dataset").mkdir()
    code, answer = run(capsys, tmp_path)
    assert (code, answer["error"]["code"]) == (4, "SES-009")
