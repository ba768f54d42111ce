from __future__ import annotations

import copy
import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.shared_data import DATA
from processing.errors import LayoutFileError
from processing.ground.room_model import OpeningKind
from processing.room.readers import horizonnet_room, panoannotator_room, read_layout, zind_room
from processing.surfaces.maps import boundary_latitudes

ZIND = {
    # Seen from above in ZInD's axes: x runs to the left of what is ahead (+y).
    "layout_raw": {
        "vertices": [[-2.0, -1.0], [1.0, -1.0], [1.0, 1.5], [-2.0, 1.5]],
        "windows": [[-0.5, 1.5], [-1.5, 1.5], [-0.4, 0.5]],
        "doors": [[1.0, 0.0], [1.0, 0.5], [-1.0, 0.3]],
        "openings": [],
    },
    "camera_height": 1.0,
    "ceiling_height": 1.7,
}


def test_zind_is_not_mirrored_and_openings_stand_on_their_walls() -> None:
    room = zind_room(ZIND)
    floor = np.array(room.floor)
    # 2 camera heights of 1.6 m to the right, 1 to the left, 1.5 ahead, 1 behind.
    assert floor.min(axis=0) == pytest.approx((-1.6, -1.6))
    assert floor.max(axis=0) == pytest.approx((3.2, 2.4))
    assert room.ceiling_height_m == pytest.approx(1.7 * 1.6)
    window, door = room.openings
    assert window.kind is OpeningKind.WINDOW
    ends = np.array([floor[window.wall], floor[(window.wall + 1) % 4]])
    assert ends[:, 1] == pytest.approx((2.4, 2.4))
    assert (window.start_m, window.end_m) == pytest.approx((0.8, 2.4))
    assert (window.sill_m, window.head_m) == pytest.approx((0.96, 2.4))
    assert door.kind is OpeningKind.DOOR
    assert floor[door.wall][0] == pytest.approx(-1.6)
    assert door.sill_m == 0.0


def test_panoannotator_z_is_negated() -> None:
    points = [{"xyz": [x, 0.0, z]} for x, z in ((-1.0, -3.0), (2.0, -3.0), (2.0, 1.0), (-1.0, 1.0))]
    data = {"cameraHeight": 1.5, "layoutHeight": 2.5, "layoutPoints": {"points": points}}
    room = panoannotator_room(data, camera_height_m=3.0)
    floor = np.array(room.floor)
    assert floor.min(axis=0) == pytest.approx((-2.0, -2.0))
    assert floor.max(axis=0) == pytest.approx((4.0, 6.0))
    assert room.ceiling_height_m == pytest.approx(5.0)


def test_horizonnet_goes_there_and_back() -> None:
    corners = np.array([(3.0, 2.0), (3.0, -1.0), (-2.0, -1.0), (-2.0, 2.0)])
    lines = []
    for x, y in corners:
        column = (math.atan2(x, y) / (2 * math.pi) + 0.5) * 1024 - 0.5
        reach = math.hypot(x, y)
        for height in (1.1, -1.6):
            row = (0.5 - math.atan2(height, reach) / math.pi) * 512 - 0.5
            lines.append(f"{column:.6f} {row:.6f}")
    room = horizonnet_room("\n".join(lines) + "\n")
    np.testing.assert_allclose(np.roll(room.floor, 0, axis=0)[::-1], corners, atol=1e-4)
    assert room.ceiling_height_m == pytest.approx(2.7, abs=1e-4)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda d: d.pop("layout_raw"), "layout_raw"),
        (lambda d: d["layout_raw"].update(vertices=[[0, 0], [1, "x"], [1, 1]]), "vertices.1"),
        (lambda d: d["layout_raw"].update(vertices=[[0, 0], [1, 2, 3]]), "vertices.1"),
        (lambda d: d["layout_raw"].update(vertices=[[-1, -1], [1, 1], [1, -1], [-1, 1]]), "cross"),
        (lambda d: d["layout_raw"].update(vertices=[]), "vertices"),
        (lambda d: d["layout_raw"].update(doors=[[1, 0], [1, 1]]), "doors"),
        (lambda d: d["layout_raw"].update(vertices=[[1e300, 0], [0, 1e300], [-1e300, -1e300]]), "vertices.0"),
        (lambda d: d.update(ceiling_height=float("nan")), "ceiling_height"),
        (lambda d: d.update(ceiling_height=0.5), "ceiling_height"),
        (lambda d: d.update(camera_height=True), "camera_height"),
    ],
)
def test_damaged_zind_is_named(change, named: str) -> None:
    data = copy.deepcopy(ZIND)
    change(data)
    with pytest.raises(LayoutFileError, match=named):
        zind_room(data)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "0 lines"),
        ("1 2\n3 4 5\n", "line 2"),
        ("1 2\nnan 3\n", "line 2"),
        ("1 2\n" * 5, "5 lines"),
        ("100 300\n100 100\n" * 3, "horizon"),
        ("2000 100\n", "line 1"),
    ],
)
def test_damaged_horizonnet_is_named(text: str, named: str) -> None:
    with pytest.raises(LayoutFileError, match=named):
        horizonnet_room(text)


def test_files_are_read_by_format_and_damage_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "zind_data.json"
    path.write_text(json.dumps({"merger": {"floor_01": {"c": {"p": {"pano_1": ZIND, "pano_12": ZIND}}}}}))
    assert len(read_layout(path, "zind", panorama="pano_1").floor) == 4
    with pytest.raises(LayoutFileError, match="pictures fit"):
        read_layout(path, "zind")
    with pytest.raises(LayoutFileError, match="zind_data"):
        read_layout(path, "led2net")
    with pytest.raises(LayoutFileError, match="line 1"):
        read_layout(path, "horizonnet")
    path.write_bytes(b"\xff\xfe\x00")
    for kind in ("zind", "led2net", "horizonnet"):
        with pytest.raises(LayoutFileError):
            read_layout(path, kind)
    with pytest.raises(LayoutFileError, match="cannot be read"):
        read_layout(tmp_path / "none.json", "led2net")


@pytest.mark.shared("paper/penn_bed", "panoramas/layout_gt")
def test_the_authors_own_room_and_a_matterport_label() -> None:
    room = read_layout(DATA / "paper" / "penn_bed" / "authors_layout.json", "led2net")
    assert len(room.floor) >= 6
    assert room.ceiling_height_m == pytest.approx(2.8649, abs=1e-3)
    folder = DATA / "panoramas" / "layout_gt"
    label = read_layout(folder / "mp3d_7y3sRwLe3Va_1410b021.json", "led2net")
    text = read_layout(folder / "mp3d_7y3sRwLe3Va_1410b021_cor.txt", "horizonnet")
    # Two files of one room by different people's conventions: mirrored, they would not meet.
    azimuth = np.linspace(-3, 3, 50)
    assert np.abs(boundary_latitudes(label, azimuth)[1] - boundary_latitudes(text, azimuth)[1]).max() < 0.05


@pytest.mark.shared("panoramas/zind/zind_data.json")
def test_all_zind_rooms_can_be_read() -> None:
    path = DATA / "panoramas" / "zind" / "zind_data.json"
    refused, pictures = [], sorted(path.parent.glob("*.jpg"))
    assert pictures
    for picture in pictures:
        try:
            room = read_layout(path, "zind", panorama=picture.stem)
            assert 2.0 < room.ceiling_height_m < 3.5
        except LayoutFileError as error:
            # Where the camera stands in a doorway, outside the room that is drawn or on its wall.
            refused.append(str(error))
    assert len(refused) <= 2
    assert all("the camera (0, 0)" in text for text in refused)
