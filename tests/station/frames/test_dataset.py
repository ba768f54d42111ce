"""What belongs together in a tree of bracket folders, by names: the layouts of Cali-HDR and Pano2Pano, and doubts."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.shared_data import DATA
from station.errors import SessionNotFoundError, UsageError
from station.frames.dataset import Bracket, Doubt, find_brackets, pair_brackets, read_table, room_and_minute, row_of
from station.session.session import Side

TABLE = "paper/cali_hdr_summary.csv"


def tree(root: Path, *folders: str, files: tuple[str, ...] = ("R0010926.JPG",)) -> Path:
    for folder in folders:
        (root / folder).mkdir(parents=True)
        for name in files:
            (root / folder / name).touch()
    return root


def names(root: Path) -> dict[str, tuple[str, str, str, str, int | None]]:
    brackets, doubts = find_brackets(root)
    assert not doubts
    return {str(b.folder.relative_to(root)): (b.side.value, b.day, b.place, b.room, b.minute) for b in brackets}


@pytest.mark.parametrize(
    ("name", "room", "minute"),
    [
        ("coda320_16:56", "coda320", 16 * 60 + 56),
        ("1f_bed_13:33", "1f_bed", 13 * 60 + 33),
        ("7528_penn_ave_11:22", "7528_penn_ave", 11 * 60 + 22),
        ("coda_334_7:56", "coda_334", 7 * 60 + 56),
        ("coda320_16_56", "coda320", 16 * 60 + 56),  # unpacked where names cannot have colons
        ("coda320_16-56", "coda320", 16 * 60 + 56),
        ("coda320_16%3A56", "coda320", 16 * 60 + 56),
        ("coda320_16：56", "coda320", 16 * 60 + 56),
        ("1349_Kitchen", "Kitchen", 13 * 60 + 49),
        ("1206_2F_SE", "2F_SE", 12 * 60 + 6),
        ("1341_3F-study", "3F-study", 13 * 60 + 41),
        ("1356", "", 13 * 60 + 56),
        ("kitchen", "kitchen", None),
        ("25:61", "25:61", None),
    ],
)
def test_room_and_time_of_a_name(name: str, room: str, minute: int | None) -> None:
    assert room_and_minute(name) == (room, minute)


def test_the_layouts_of_the_two_datasets(tmp_path: Path) -> None:
    root = tree(
        tmp_path / "Pano2Pano_Release",
        "20230521/pano/coda320_16:56",
        "20230521/fisheye/coda320_16:53",
        "20230709/essex/theta/essex_bed_14:19",
        "20230709/essex/fisheye/essex_bed_14:16",
        "20240330/indoor/1349_Kitchen",
        "20240330/outdoor/1339_kitchen",
        "20240324/12 Elm St/Outdoor/1154_2F_SW",
        "20240312/1356-in",
        "20240312/1400-out",
        "20230528/theta",
    )
    assert names(root) == {
        "20230521/pano/coda320_16:56": ("indoor", "2023-05-21", "", "coda320", 1016),
        "20230521/fisheye/coda320_16:53": ("outdoor", "2023-05-21", "", "coda320", 1013),
        "20230709/essex/theta/essex_bed_14:19": ("indoor", "2023-07-09", "essex", "essex_bed", 859),
        "20230709/essex/fisheye/essex_bed_14:16": ("outdoor", "2023-07-09", "essex", "essex_bed", 856),
        "20240330/indoor/1349_Kitchen": ("indoor", "2024-03-30", "", "Kitchen", 829),
        "20240330/outdoor/1339_kitchen": ("outdoor", "2024-03-30", "", "kitchen", 819),
        "20240324/12 Elm St/Outdoor/1154_2F_SW": ("outdoor", "2024-03-24", "12 Elm St", "2F_SW", 714),
        "20240312/1356-in": ("indoor", "2024-03-12", "", "", 836),
        "20240312/1400-out": ("outdoor", "2024-03-12", "", "", 840),
        "20230528/theta": ("indoor", "2023-05-28", "", "", None),
    }


def test_a_part_of_the_tree_and_what_is_no_frame(tmp_path: Path) -> None:
    root = tree(tmp_path / "20230521", "theta/coda320_16:56", ".idea/theta", "__MACOSX/theta/x_16:56")
    tree(root, "theta/notes", files=("notes.txt", "._R1.JPG", ".DS_Store"))
    assert names(root) == {"theta/coda320_16:56": ("indoor", "2023-05-21", "", "coda320", 1016)}
    (bracket,) = find_brackets(root)[0]
    assert [path.name for path in bracket.files] == ["R0010926.JPG"]


@pytest.mark.parametrize(
    ("folder", "what"), [("20230521/attic_12:00", "neither"), ("20230521/theta/sky room_12:00", "both")]
)
def test_a_name_that_does_not_say_the_side_is_a_doubt(tmp_path: Path, folder: str, what: str) -> None:
    brackets, doubts = find_brackets(tree(tmp_path, folder))
    assert not brackets
    assert [(what in d.message, d.paths) for d in doubts] == [(True, (str(tmp_path / folder),))]


def test_a_tree_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SessionNotFoundError):
        find_brackets(tmp_path / "none")


def bracket(side: Side, name: str, day: str = "2023-05-21", part: int = 0) -> Bracket:
    room, minute = room_and_minute(name)
    return Bracket(Path(side) / name, side, day, "", room, minute, (), part)


def paired(*brackets: Bracket) -> list[tuple[str | None, str | None]]:
    pairs, doubts = pair_brackets(brackets)
    assert not doubts
    return [tuple(b.folder.name if b else None for b in (p.indoor, p.outdoor)) for p in pairs]  # type: ignore[misc]


def test_a_room_has_the_sky_nearest_in_time() -> None:
    rooms = [bracket(Side.INDOOR, n) for n in ("coda320_10:00", "coda320_11:00", "coda320_12:00", "attic_10:00")]
    skies = [bracket(Side.OUTDOOR, n) for n in ("coda320_09:57", "Coda_320_10:58", "coda320_12:11")]
    assert paired(*rooms, *skies) == [
        ("coda320_10:00", "coda320_09:57"),
        ("coda320_11:00", "Coda_320_10:58"),
        ("coda320_12:00", None),  # 11 minutes
        ("attic_10:00", None),
        (None, "coda320_12:11"),  # a session of its own: nothing is lost
    ]
    assert paired(rooms[0], bracket(Side.OUTDOOR, "coda320_10:00", day="2023-05-22"))[0] == ("coda320_10:00", None)


def test_one_sky_serves_several_rooms_and_the_only_one_needs_no_time() -> None:
    rooms = [bracket(Side.INDOOR, n) for n in ("1348_Kitchen", "1351_Kitchen")]
    sky = bracket(Side.OUTDOOR, "1350_kitchen")
    assert paired(*rooms, sky) == [("1348_Kitchen", "1350_kitchen"), ("1351_Kitchen", "1350_kitchen")]
    assert paired(bracket(Side.INDOOR, "attic"), bracket(Side.OUTDOOR, "attic")) == [("attic", "attic")]


def test_two_skies_equally_near_are_a_doubt_that_names_them() -> None:
    room = bracket(Side.INDOOR, "coda320_10:00")
    skies = [bracket(Side.OUTDOOR, n) for n in ("coda320_09:58", "coda320_10:02")]
    pairs, doubts = pair_brackets([room, *skies])
    assert not pairs
    assert doubts[0].paths == tuple(str(b.folder) for b in (room, *skies))


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


HEAD = "date,scene_name,theta_time,luminance_cd_m2,illuminance_lux,nd_filter,natural_light\n"


def test_a_row_is_found_by_day_room_and_minute(tmp_path: Path) -> None:
    rows = read_table(write(tmp_path, HEAD + "20230521,coda_320,16:56,34.63,28250,NO,With electrical light\n"))
    row = row_of(bracket(Side.INDOOR, "coda320_16:56"), rows)
    assert row is not None
    assert not isinstance(row, Doubt)
    assert (row.luminance_cd_m2, row.illuminance_lx, row.nd_filter, row.remark) == (
        34.63,
        28250.0,
        "NO",
        "natural light: With electrical light",
    )
    assert row_of(bracket(Side.INDOOR, "coda320_16:57"), rows) is row
    for other in ("coda320_16:58", "coda334_16:56", "coda320"):
        assert row_of(bracket(Side.INDOOR, other), rows) is None


def test_rows_equally_near_are_a_doubt(tmp_path: Path) -> None:
    rows = read_table(write(tmp_path, HEAD + "20230521,coda_320,16:56,1,,,\n20230521,coda320,16:56,2,,,\n"))
    found = row_of(bracket(Side.INDOOR, "coda320_16:56"), rows)
    assert isinstance(found, Doubt)
    assert "lines 2, 3" in found.message


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("", "needs once: date"),
        ("date,scene_name\n", "needs once: theta_time"),
        ("date,scene_name,theta_time,luminance_cd_m2,luminance_cd_m2\n", "needs once: luminance_cd_m2"),
        (HEAD + "20231321,a,1:00,1,,,\n", "line 2: '20231321' is not a date"),
        (
            HEAD + "20231221,a,1:00,bright,,,\n",
            "line 2: luminance and illuminance are 0 to 1e10",
        ),
        (HEAD + "20231221,a,1:00,nan,,,\n", "line 2: luminance and illuminance are 0 to 1e10"),
        (HEAD + "20231221,a,1:00,-3,,,\n", "line 2: luminance and illuminance are 0 to 1e10"),
        (
            HEAD + "20231221,a,1:00,3,1e400,,\n",
            "line 2: luminance and illuminance are 0 to 1e10",
        ),
    ],
)
def test_a_table_that_cannot_be_right_is_named_with_its_line(tmp_path: Path, text: str, what: str) -> None:
    with pytest.raises(UsageError, match=what):
        read_table(write(tmp_path, text))
    with pytest.raises(UsageError, match="cannot be read"):
        read_table(tmp_path / "none.csv")


@pytest.mark.shared(TABLE)
def test_the_authors_table_is_read_whole() -> None:
    rows = read_table(DATA / TABLE)
    assert len(rows) == 137
    assert all(row.minute is not None and row.luminance_cd_m2 for row in rows)
    assert sum(row.nd_filter == "NO" for row in rows) > 0
    indoor = [
        Bracket(Path(str(i)), Side.INDOOR, row.day, "", row.room.replace("_", ""), row.minute, ())
        for i, row in enumerate(rows)
    ]
    (slip,) = [row.line for row in rows if row.contradicts_itself]
    found = [row_of(one, rows) for one in indoor]
    assert [row for row in found if row not in rows] == []
    assert [row.line for row, one in zip(rows, found, strict=True) if one is not row] == [slip]
