"""The emptied room on a small painted room: what stays, what is filled, and the ends."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from processing.errors import FillerError, ParameterError, RemovalError
from processing.ground.arrays import Flags
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.pictures.images import LuminanceImage, Validity
from processing.removal.fill import Others, Quick, empty_room
from processing.removal.learned import LamaFiller
from processing.removal.lift import Shade, lifted, light_without
from processing.removal.plane_fill import SURE, FilledPlane
from processing.sphere import Equirectangular
from processing.surfaces.maps import FIRST_WALL, FLOOR, plane_map, surface_maps
from tests.conftest import LONG

ROWS = 96
GEOMETRY = Equirectangular(2 * ROWS, ROWS)


def box_room() -> RoomModel:
    opening = Opening(kind=OpeningKind.WINDOW, wall=2, start_m=1.4, end_m=2.6, sill_m=0.9, head_m=2.1)
    return RoomModel(
        source="given",
        floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)),
        camera_height_m=1.6,
        ceiling_height_m=2.7,
        openings=(opening,),
    )


@lru_cache
def painted() -> tuple[LuminanceImage, npt.NDArray[np.int16], npt.NDArray[np.float64]]:
    """Return a room of plain walls and a tiled floor under light that falls from the window."""
    room = box_room()
    maps = surface_maps(room, GEOMETRY)
    longitude = ((np.arange(2 * ROWS) + 0.5) / (2 * ROWS) - 0.5) * 2 * math.pi
    latitude = (0.5 - (np.arange(ROWS) + 0.5) / ROWS) * math.pi
    flat = np.cos(latitude)[:, None]
    rays = np.stack(
        [
            flat * np.sin(longitude),
            flat * np.cos(longitude),
            np.broadcast_to(np.sin(latitude)[:, None], (ROWS, 2 * ROWS)),
        ],
        axis=-1,
    )
    place = rays * maps.depth_m[..., None] + np.array([0, 0, 1.6])
    grey = np.where(maps.plane == 0, 20.0, np.where(maps.plane == 1, 60.0, 45.0))
    dark = ((np.floor(place[..., 0] / 0.5) + np.floor(place[..., 1] / 0.5)) % 2 > 0) & (maps.plane == 0)
    light = np.exp(0.15 * place[..., 1])
    value = np.where(dark, 8.0, grey) * light
    value[maps.opening == 0] = 5000.0
    rgb = (value[..., None] * [1.0, 0.95, 0.9]).astype(np.float32)
    image = LuminanceImage(rgb, np.full(value.shape, 0.02, np.float32), np.zeros(value.shape, np.uint8), GEOMETRY, 0.02)
    return image, maps.plane, place


def error(image: LuminanceImage, where: Flags, target: Flags) -> float:
    """Return the median relative error of a picture with ``target`` spoilt, emptied, over ``where``."""
    spoilt = image.rgb.copy()
    spoilt[target] = 333.0
    found = empty_room(replace(image, rgb=spoilt), target, box_room(), quality="draft").image.rgb
    return float(np.median(np.abs(found[where] - image.rgb[where]) / image.rgb[where]))


def patch(rows: slice, columns: slice) -> Flags:
    mask = np.zeros((ROWS, 2 * ROWS), bool)
    mask[rows, columns] = True
    return mask


@pytest.mark.parametrize(
    ("rows", "columns", "worst"),
    [
        (slice(55, 66), slice(20, 34), 0.12),  # wall and floor
        (slice(40, 52), slice(0, 8), 0.04),  # at the seam
        (slice(88, 96), slice(0, 2 * ROWS), 0.5),  # the nadir: half the tiles' size
        (slice(0, 6), slice(0, 2 * ROWS), 0.03),  # the zenith
        (slice(38, 52), slice(110, 125), 0.06),  # beside a window of 5000 cd/m2: no glow bleeds in
    ],
)
def test_what_was_hidden_comes_back(rows: slice, columns: slice, worst: float) -> None:
    image, _, _ = painted()
    target = patch(rows, columns)
    assert error(image, target & (image.rgb[..., 0] < 1000), target) < worst


def test_outside_the_target_nothing_changes_by_a_bit() -> None:
    image, planes, _ = painted()
    target = patch(slice(50, 70), slice(100, 130))
    found = empty_room(image, target, box_room(), quality="draft")
    for name in ("rgb", "uncertainty", "validity"):
        assert np.array_equal(getattr(found.image, name)[~target], getattr(image, name)[~target])
    assert (found.provenance[~target] == 0).all()
    assert (found.provenance[target] > 0).all()
    assert (found.image.validity[target] == Validity.REPAIRED).all()
    assert (found.confidence[~target] == 1).all()
    assert np.isfinite(found.image.rgb).all()
    assert [f.texture.plane.index for f in found.textures] == sorted(set(planes[target].tolist()))


def test_no_target_and_one_pixel() -> None:
    image, _, _ = painted()
    nothing = np.zeros((ROWS, 2 * ROWS), bool)
    assert empty_room(image, nothing, box_room()).image is image
    one = nothing.copy()
    one[70, 40] = True
    found = empty_room(image, one, box_room(), quality="draft")
    assert (found.provenance > 0).sum() == 1


def test_a_floor_hidden_altogether_is_said() -> None:
    image, planes, _ = painted()
    found = empty_room(image, planes == 0, box_room(), quality="draft")
    assert np.isfinite(found.image.rgb).all()
    assert (found.confidence[planes == 0] < 0.1).all()
    assert (found.provenance[planes == 0] == 2).all()
    assert any("hidden altogether" in note for note in found.notes)


def test_a_target_thinner_than_a_texel_is_not_hidden_altogether() -> None:
    shape, target = (512, 1024), np.zeros((512, 1024), bool)
    target[60:62, 300:302] = True
    flat = np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), Equirectangular(1024, 512), 0.02
    found = empty_room(
        LuminanceImage(np.full((*shape, 3), 9.0, np.float32), *flat), target, box_room(), quality=Quick()
    )
    assert not found.textures[0].hole.any()
    assert not any("hidden altogether" in note for note in found.notes)


@pytest.mark.sweep
@pytest.mark.parametrize("ceiling_m", [2.70, 2.704, 2.706] if LONG else [2.704])  # the last one has no such row
def test_the_hidden_foot_of_a_door_is_the_door_s(ceiling_m: float) -> None:
    """However many rows of texture the wall's height makes: the last one's middle may lie below its foot."""
    door = Opening(kind=OpeningKind.DOOR, wall=2, start_m=1.5, end_m=2.4, sill_m=0.0, head_m=2.03)
    room = box_room().model_copy(update={"ceiling_height_m": ceiling_m, "openings": (door,)})
    geometry = Equirectangular(1024, 512)
    maps = surface_maps(room, geometry)
    grey = np.where(maps.opening == 0, 8.0, np.where(maps.plane == 0, 20.0, 45.0))
    grey = grey * np.random.default_rng(1).normal(1, 0.01, grey.shape)
    flat = np.full(grey.shape, 0.02, np.float32), np.zeros(grey.shape, np.uint8), geometry, 0.02
    target = np.zeros(grey.shape, bool)
    target[300:400, 430:600] = True
    image = LuminanceImage(np.repeat(grey[..., None], 3, axis=2).astype(np.float32), *flat)
    found = empty_room(image, target, room, quality="draft").image.rgb[..., 0]
    foot = target & (maps.opening == 0) & np.roll(maps.plane == 0, -6, axis=0)
    assert foot.sum() > 50
    assert np.median(found[foot]) == pytest.approx(8, rel=0.02)


def test_a_preview_knows_that_a_door_was_moved() -> None:
    """The picture and the mask are the same, and so is the wall but for its door."""
    image, _, _ = painted()
    target, quick = patch(slice(44, 60), slice(92, 108)), Quick()

    def emptied(start_m: float, quality: Quick) -> npt.NDArray[np.float32]:
        door = Opening(kind=OpeningKind.DOOR, wall=2, start_m=start_m, end_m=start_m + 1.5, sill_m=0.0, head_m=2.1)
        room = box_room().model_copy(update={"openings": (door,)})
        return np.asarray(empty_room(image, target, room, quality=quality).image.rgb)

    before, after = emptied(0.1, quick), emptied(2.3, quick)
    assert np.array_equal(after, emptied(2.3, Quick()))
    assert not np.array_equal(after, before)


def test_a_target_that_covers_everything_is_refused() -> None:
    image, planes, _ = painted()
    everything = np.ones_like(planes, bool)
    with pytest.raises(RemovalError, match="no part of the room is left"):
        empty_room(image, everything, box_room())
    rgb = image.rgb.copy()
    rgb[:5] = np.nan
    everything[:5] = False
    with pytest.raises(RemovalError, match="no part of the room is left"):
        empty_room(replace(image, rgb=rgb), everything, box_room())


def test_walls_hidden_altogether_are_not_black() -> None:
    image, planes, _ = painted()
    found = empty_room(image, planes >= 2, box_room(), quality="draft")
    assert found.image.rgb[planes >= 2].min() > 5


def test_four_fifths_of_the_floor() -> None:
    image, planes, place = painted()
    target = (planes == 0) & (place[..., 0] > -1.2)
    found = empty_room(image, target, box_room(), quality="draft")
    assert np.isfinite(found.image.rgb).all()
    middle = np.median(found.image.rgb[target][:, 0])
    assert 4 < middle < 40


def test_nan_where_the_lens_saw_nothing() -> None:
    image, _, _ = painted()
    rgb, validity = image.rgb.copy(), image.validity.copy()
    rgb[:3], validity[:3] = np.nan, Validity.OUTSIDE
    target = patch(slice(2, 9), slice(50, 90))
    found = empty_room(replace(image, rgb=rgb, validity=validity), target, box_room(), quality="draft")
    assert np.isfinite(found.image.rgb[target]).all()
    assert np.isnan(found.image.rgb[:2]).all()


def test_nothing_is_copied_from_sunlight() -> None:
    """A patch beside the hole, forty times as bright: what is filled is as if it were not there."""
    image, planes, _ = painted()
    chair, sun = patch(slice(62, 70), slice(120, 130)), patch(slice(62, 72), slice(130, 142))
    lit = image.rgb.copy()
    lit[sun] *= 40
    plain = empty_room(image, chair, box_room(), sunlight=sun, quality="draft").image.rgb
    beside = empty_room(replace(image, rgb=lit), chair, box_room(), sunlight=sun, quality="draft").image.rgb
    assert (planes[chair] == 0).any()
    assert float(np.median(beside[chair] / plain[chair])) == pytest.approx(1, abs=0.2)


def test_wrong_sizes_are_reported() -> None:
    image, _, _ = painted()
    with pytest.raises(ParameterError):
        empty_room(image, np.zeros((3, 4), bool), box_room())
    with pytest.raises(ParameterError):
        empty_room(image, np.zeros((ROWS, 2 * ROWS), bool), box_room(), quality="best")


def onnx_file(tmp_path: Path, *, scale: float = 255.0, mask_name: str = "mask") -> Path:
    """Write a stand-in for LaMa: grey in the hole, the picture elsewhere."""
    import onnx

    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    shape = [1, 3, "h", "w"]
    inputs = [
        helper.make_tensor_value_info("image", kind, shape),
        helper.make_tensor_value_info(mask_name, kind, [1, 1, "h", "w"]),
    ]
    constants = [helper.make_tensor("half", kind, [], [0.5]), helper.make_tensor("scale", kind, [], [scale])]
    nodes = [
        helper.make_node("Sub", ["half", "image"], ["change"]),
        helper.make_node("Mul", ["change", mask_name], ["inside"]),
        helper.make_node("Add", ["image", "inside"], ["sum"]),
        helper.make_node("Mul", ["sum", "scale"], ["output"]),
    ]
    outputs = [helper.make_tensor_value_info("output", kind, shape)]
    graph = helper.make_graph(nodes, "toy", inputs, outputs, constants)
    path = tmp_path / "toy.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    return path


@pytest.mark.parametrize("scale", [1.0, 255.0])
def test_a_network_fills_where_ours_is_unsure(tmp_path: Path, scale: float) -> None:
    image, planes, _ = painted()
    target = planes == 0
    filler = LamaFiller(onnx_file(tmp_path, scale=scale), threads=1)
    ours = empty_room(image, target, box_room(), quality="draft")
    theirs = empty_room(image, target, box_room(), quality="draft", filler=filler)
    assert not np.allclose(ours.image.rgb[target], theirs.image.rgb[target])
    assert np.array_equal(theirs.image.rgb[~target], image.rgb[~target])
    assert theirs.confidence[target].mean() > ours.confidence[target].mean()


def test_what_a_network_invents_is_never_called_continued(tmp_path: Path) -> None:
    """A plain wall, a third of which is seen: ours is a continuation, the network's is not, however sure it is."""
    image, planes, _ = painted()
    wall = int(planes[ROWS // 2, 0])
    target = (planes == wall) & (np.arange(2 * ROWS)[None, :] % 37 > 12)
    filled = empty_room(image, target, box_room(), quality="draft")
    plane = next(f for f in filled.textures if f.texture.plane.index == wall)
    assert plane.continued[plane.hole].all(), "plain"
    unsure = replace(plane, confidence=np.where(plane.hole, 0.3, 1).astype(np.float32))
    theirs = LamaFiller(onnx_file(tmp_path), threads=1)(unsure)
    invented = theirs.hole & (np.abs(theirs.values - plane.values).max(axis=-1) > 0.1 * plane.values.max(axis=-1))
    assert invented.any()
    assert theirs.confidence[invented].max() > SURE
    assert not theirs.continued[invented].any()

    def filler(done: FilledPlane) -> FilledPlane:
        return replace(theirs, texture=done.texture) if done.texture.plane.index == wall else done

    drawn = empty_room(image, target, box_room(), quality="draft", filler=filler)
    assert (drawn.provenance[target] == 2).mean() > 0.5


def test_networks_that_do_not_fit_are_reported(tmp_path: Path) -> None:
    with pytest.raises(FillerError, match="cannot be read"):
        LamaFiller(tmp_path / "none.onnx")
    with pytest.raises(FillerError, match="inputs"):
        LamaFiller(onnx_file(tmp_path, mask_name="hole"))
    with pytest.raises(FillerError, match="mean"):
        LamaFiller(onnx_file(tmp_path, scale=10.0))


def test_a_wall_learns_nothing_from_floor_that_is_seen_before_it() -> None:
    """The room is taken for too small: its wall's foot shows orange floor, which does not glow into what is filled."""
    image, planes, _ = painted()
    chair, floor = patch(slice(50, 58), slice(20, 34)), patch(slice(58, 61), slice(10, 44))
    assert (planes[floor] >= 2).all()
    light = image.rgb.copy()
    light[floor] *= (1.5, 1.1, 0.8)
    off = []
    for unlike in (floor, np.zeros_like(floor)):
        spoilt = replace(image, rgb=light)
        found = empty_room(spoilt, chair, box_room(), others=Others(unlike=unlike), quality="draft").image.rgb
        assert np.array_equal(found[floor], light[floor])
        off.append(float(np.abs(np.log(found[chair] / image.rgb[chair])).max()))
    assert off[0] < 0.22 < 0.38 < off[1]


def breast_room(first: int) -> RoomModel:
    """Return a room with a chimney breast of 12 cm, of which the camera sees a side as a sliver: the wall 5 - first."""
    breast = ((1.2, 2.0), (1.2, 1.88), (0.4, 1.88), (0.4, 2.0))
    floor = ((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), *breast, (-2.0, 2.0))
    return box_room().model_copy(update={"floor": floor[first:] + floor[:first], "openings": ()})


def even(rows: int, level: float = 100.0) -> LuminanceImage:
    shape = (rows, 2 * rows)
    rgb, doubt = np.full((*shape, 3), level, np.float32), np.full(shape, 0.02, np.float32)
    return LuminanceImage(rgb, doubt, np.zeros(shape, np.uint8), Equirectangular(2 * rows, rows), 0.02)


@pytest.mark.parametrize("first", [0, 6])
def test_a_wall_that_shows_as_a_sliver_has_light_where_the_working_size_does_not_see_it(first: int) -> None:
    room, rows, small = breast_room(first), 256, 32
    sliver = plane_map(room, Equirectangular(2 * rows, rows)) == FIRST_WALL + 5 - first + 8 * (first > 5)
    coarse = plane_map(room, Equirectangular(2 * small, small))
    assert sliver.any()
    assert len(np.unique(coarse)) == len(np.unique(plane_map(room, Equirectangular(2 * rows, rows)))) - 1
    light = np.where(coarse == FLOOR, 900.0, 300.0)[..., None] * np.ones(3)
    shade = Shade(np.zeros_like(light), light.astype(np.float32), np.ones(coarse.shape, bool))
    found, _ = light_without(shade, room, rows)
    assert np.median(found[sliver]) == pytest.approx(300, rel=0.02), "as the wall beside it, not as the floor"
    target = np.zeros(sliver.shape, bool)
    target[100:140, 200:300] = True
    done, _ = lifted(even(rows), target, room, shade, quality="draft")
    np.testing.assert_allclose(done.image.rgb[sliver], 100, rtol=0.02)


def test_light_goes_on_over_the_same_angles_at_any_working_size() -> None:
    """From what is known on one side of a plane (dark) and the other (bright), 45 degrees apart."""
    room, found = box_room().model_copy(update={"openings": ()}), []
    for rows in (64, 128):
        light = np.full((rows, 2 * rows, 3), 100, np.float32)
        light[:, rows:] = 900
        light[:, rows * 7 // 8 : rows * 9 // 8] = 0
        shade = Shade(np.zeros_like(light), light, np.ones(light.shape[:2], bool))
        found.append(light_without(shade, room, 64)[0][30:34, 56:72, 0])
    assert found[1][:, 1].max() < 150 < 600 < found[1][:, -2].min(), "on both sides as beside it"
    for part in (np.s_[:, :6], np.s_[:, -6:]):  # without the step in the middle
        np.testing.assert_allclose(found[0][part], found[1][part], rtol=0.05)


def test_an_even_room_stays_even_where_a_corner_hides_some_of_its_planes() -> None:
    """Texels behind the corner hold nothing, and pixels at its edge take nothing from them."""
    floor = ((-1.6, -2.2), (3.4, -2.2), (3.4, -0.2), (0.4, -0.2), (0.4, 2.8), (-1.6, 2.8))
    room = box_room().model_copy(update={"floor": floor, "openings": ()})
    picture = even(128)
    target = np.zeros((128, 256), bool)
    target[35:105] = (np.arange(256) // 15 % 2 == 0)[None]
    done = empty_room(picture, target, room, quality="draft")
    assert np.abs(done.image.rgb / 100 - 1).max() < 1e-3
