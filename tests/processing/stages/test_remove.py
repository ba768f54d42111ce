"""The stage remove: when it is skipped, what it makes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from processing.errors import ParameterError
from processing.exchange.jpeg_files import removed_by
from processing.ground.room_model import RoomModel
from processing.ground.seam import grown
from processing.pictures.images import LuminanceImage
from processing.pipeline import STAGES
from processing.removal.shadows import MOST_TINT, relit_gain
from processing.report.sections import remove_section, room_section
from processing.segmentation.evidence import SceneClass, SceneEvidence, write_evidence
from processing.sphere import Equirectangular
from processing.stages.contract import Quality, StageContext
from processing.stages.detect import drawn_over
from processing.stages.parameters import RemoveParameters
from processing.stages.remove import nothing_to_remove, run
from processing.stages.upright import UNTRUSTED
from processing.surfaces.maps import FIRST_WALL, FLOOR, plane_map

ROWS = 32
MARGIN_DEG = 6.0
ROOM = RoomModel(
    source="given",
    floor=((-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)),
    camera_height_m=1.6,
    ceiling_height_m=2.7,
)


def picture() -> LuminanceImage:
    shape = (ROWS, 2 * ROWS)
    rgb = np.random.default_rng(1).uniform(40, 42, (*shape, 3)).astype(np.float32)
    return LuminanceImage(
        rgb, np.full(shape, 0.02, np.float32), np.zeros(shape, np.uint8), Equirectangular(2 * ROWS, ROWS), 0.02
    )


def context(
    folder: Path,
    parameters: RemoveParameters | None = None,
    **artifacts: Any,
) -> StageContext:
    given = {"indoor": picture(), "room": ROOM} | artifacts

    def fetch(_stage: str, name: str) -> Any:
        return given.get(name)

    return StageContext(
        session=None,  # type: ignore[arg-type]
        session_path=folder,
        folder=folder,
        parameters=parameters or RemoveParameters(),
        fetch=fetch,
        summary=lambda _stage: {"metrics": {"margin_deg": MARGIN_DEG}},
        quality=Quality.DRAFT,
    )


def target(*, empty: bool = False) -> np.ndarray[Any, np.dtype[np.bool_]]:
    mask = np.zeros((ROWS, 2 * ROWS), bool)
    if not empty:
        mask[20:26, 10:20] = True
    return mask


def test_it_is_skipped_where_there_is_nothing_to_do(tmp_path: Path) -> None:
    assert nothing_to_remove(context(tmp_path, target=target())) is None
    assert nothing_to_remove(context(tmp_path, target=target(empty=True))) == "nothing to remove"
    assert "no target" in str(nothing_to_remove(context(tmp_path)))
    assert "no room" in str(nothing_to_remove(context(tmp_path, target=target(), room=None)))


def test_what_it_makes(tmp_path: Path) -> None:
    made = run(context(tmp_path, target=target()))
    empty, filled = made.artifacts["empty"], made.artifacts["filled"]
    assert isinstance(empty, LuminanceImage)
    assert np.array_equal(np.asarray(filled), target())
    assert np.array_equal(empty.rgb[~target()], picture().rgb[~target()])
    with np.load(tmp_path / "surfaces.npz") as kept:
        assert {"provenance", "confidence", "floor_rgb", "floor_hole", "floor_px_per_m"} <= set(kept.files)
        assert kept["floor_rgb"].dtype == np.float16  # the bits that are known of estimated light
    section = remove_section(empty, np.asarray(filled), made.metrics)
    assert [one.title for one in section.pictures] == ["Filled areas"]


def test_textures_brighter_than_a_half_holds_stay_whole(tmp_path: Path) -> None:
    bright = replace(picture(), rgb=picture().rgb * np.float32(1e4))
    run(context(tmp_path, target=target(), indoor=bright))
    with np.load(tmp_path / "surfaces.npz") as kept:
        assert kept["floor_rgb"].dtype == np.float32
        assert np.isfinite(kept["floor_rgb"]).all()


def test_a_mask_of_another_size_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="target is 8 x 4, the panorama 64 x 32"):
        run(context(tmp_path, target=np.ones((4, 8), bool)))


def white_network(folder: Path) -> Path:
    """Write a stand-in for LaMa that fills every hole with white."""
    import onnx

    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    sizes = {"image": [1, 3, "h", "w"], "mask": [1, 1, "h", "w"], "output": [1, 3, "h", "w"]}
    values = {name: helper.make_tensor_value_info(name, kind, size) for name, size in sizes.items()}
    nodes = [helper.make_node("Max", ["image", "mask"], ["output"])]
    graph = helper.make_graph(nodes, "white", [values["image"], values["mask"]], [values["output"]])
    path = folder / "white.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    return path


def test_a_network_of_the_user_fills_what_ours_cannot(tmp_path: Path) -> None:
    """`--filler` reaches it: of a floor that nobody sees, the network's white, four times the median, is taken."""
    floor = plane_map(ROOM, picture().geometry) == FLOOR  # type: ignore[arg-type]
    empty = run(context(tmp_path, RemoveParameters(filler=white_network(tmp_path)), target=floor)).artifacts["empty"]
    ours = run(context(tmp_path, target=floor)).artifacts["empty"]
    assert isinstance(empty, LuminanceImage)
    assert isinstance(ours, LuminanceImage)
    assert np.median(empty.rgb[floor]) > 2 * np.median(ours.rgb[floor])
    assert np.array_equal(empty.rgb[~floor], picture().rgb[~floor])


def test_the_option_filler_is_that_of_this_stage() -> None:
    stage = next(one for one in STAGES if one.name == "remove")
    result = {flag: (option.kind, option.name) for flag, option in stage.options.items()}
    assert result["--filler"] == ("file", "filler")
    assert result["--filler-channels"] == ("parameter", "filler_channels")


@pytest.mark.parametrize(
    "shares",
    [
        {SceneClass.FURNITURE: 1.0},
        {SceneClass.TRIPOD: 1.0},
        {SceneClass.FURNITURE: 0.35, SceneClass.DOOR: 0.3, SceneClass.WALL: 0.2, SceneClass.FLOOR: 0.15},
    ],
    ids=["furniture", "equipment", "hardly floor"],
)
def test_rests_of_things_that_the_network_sees_are_no_part_of_the_floor(
    tmp_path: Path, shares: dict[SceneClass, float]
) -> None:
    """A red thing beside the target, which detection left out: with evidence of it, none of it is copied; nor where
    it is a tripod's leg, or may be a door's leaf as well, as long as it is hardly floor.
    """
    image = picture()
    floor = plane_map(ROOM, image.geometry) == FLOOR  # type: ignore[arg-type]
    thing, hole = patch(slice(20, 27), slice(20, 40)), patch(slice(20, 27), slice(4, 20)) & floor
    image.rgb[thing] = [60.0, 6.0, 6.0]
    probabilities = np.zeros((len(SceneClass), ROWS, 2 * ROWS), np.float32)
    probabilities[SceneClass.FLOOR] = 1 - thing
    for kind, share in shares.items():
        probabilities[kind, thing] = share
    write_evidence(tmp_path / "evidence.npz", SceneEvidence(probabilities, "test"))
    evidence = tmp_path / "evidence.npz"
    found = run(context(tmp_path, target=hole, indoor=image, evidence=evidence)).artifacts["empty"]
    assert isinstance(found, LuminanceImage)
    assert (found.rgb[hole][:, 1] > 25).all(), "grey, as the floor"
    assert np.array_equal(found.rgb[thing], image.rgb[thing]), "what is no target stays"


def test_it_says_whether_furniture_went(tmp_path: Path) -> None:
    """A bare room without its tripod had no furniture; of a mask that somebody gave nobody knows."""
    given = replace(context(tmp_path, target=target()), summary=lambda _stage: {"metrics": {}, "given": ["target"]})
    every = [
        context(tmp_path, target=target(), tripod=target()),
        context(tmp_path, target=target(), furniture=target()),
    ]
    said = [run(one).metrics["furniture"] for one in (*every, given)]
    assert said == [False, True, True]
    results = [{"metrics": {"furniture": one}, "left_out": {}, "skipped": ""} for one in said]
    assert [removed_by(one) for one in results] == ["equipment", "furniture", "furniture"]
    assert removed_by({"metrics": {}, "left_out": {}, "skipped": "nothing to remove"}) == ""


def patch(rows: slice, columns: slice) -> np.ndarray[Any, np.dtype[np.bool_]]:
    mask = target(empty=True)
    mask[rows, columns] = True
    return mask


def test_sunlight_that_is_kept_keeps_its_rim_too(tmp_path: Path) -> None:
    """A target that was grown over a patch and over a chair, which meet: only the chair's part is filled."""
    sun, chair = patch(slice(22, 26), slice(20, 30)), patch(slice(20, 24), slice(30, 34))
    margin = math.radians(MARGIN_DEG)
    found = {"target": grown(sun | chair, margin), "sunlight": sun, "furniture": chair}
    kept = run(context(tmp_path, RemoveParameters(keep_sunlight=True), **found))
    empty, filled = kept.artifacts["empty"], np.asarray(kept.artifacts["filled"])
    assert isinstance(empty, LuminanceImage)
    assert np.array_equal(filled, grown(chair, margin) & ~sun)
    for name in ("rgb", "uncertainty", "validity"):
        assert np.array_equal(getattr(empty, name)[~filled], getattr(picture(), name)[~filled])
    alone = run(context(tmp_path, RemoveParameters(keep_sunlight=True), target=grown(sun, margin), sunlight=sun))
    assert not np.asarray(alone.artifacts["filled"]).any()
    gone = run(context(tmp_path, **found))
    assert np.array_equal(np.asarray(gone.artifacts["filled"]), found["target"])


def test_what_was_drawn_goes_though_sunlight_stays(tmp_path: Path) -> None:
    """A thing that a user adds (--mask-add) has no margin, and may stand in a patch of sun: none of it stays."""
    drawn = patch(slice(18, 24), slice(28, 40))
    sun = patch(slice(22, 26), slice(20, 30)) & ~drawn
    things = drawn_over("furniture", target(empty=True), [drawn, np.False_, np.False_])
    found = {"target": grown(sun, math.radians(MARGIN_DEG)) | drawn, "sunlight": sun, "furniture": things}
    kept = run(context(tmp_path, RemoveParameters(keep_sunlight=True), **found))
    assert np.asarray(kept.artifacts["filled"])[drawn].all()


def test_a_doubtful_room_is_not_emptied_unasked_and_what_stands_is_said(tmp_path: Path) -> None:
    doubtful = ROOM.model_copy(update={"source": "estimated", "confidence": 0.1})
    target = np.ones((ROWS, 2 * ROWS), bool)
    facts = {"wall_confidences": [0.9, 0.1, 0.2, 0.8], "ceiling_confidence": 0.9}

    def _reason(room: RoomModel, **asked: bool) -> str | None:
        made = context(tmp_path, RemoveParameters(**asked), room=room, target=target)
        return nothing_to_remove(replace(made, summary=lambda _stage: {"metrics": facts}))

    reason = _reason(doubtful)
    assert reason is not None
    assert "walls 1, 4 and the ceiling's height can be trusted" in reason
    assert "--doubtful-room" in reason
    walls = room_section(picture(), doubtful, facts, {}).tables[0].rows
    assert [name for name, _, sure in walls if float(sure) > 0.5] == ["wall 1", "wall 4"], "one wall has one number"
    assert _reason(doubtful, doubtful_room=True) is None
    assert _reason(doubtful.model_copy(update={"confidence": 0.3})) is None
    assert _reason(ROOM.model_copy(update={"confidence": 0.1})) is None, "who gives a room vouches for it"


def test_of_a_doubtful_room_only_what_touches_nothing_but_walls_that_stand_is_removed_on_request(
    tmp_path: Path,
) -> None:
    doubtful = ROOM.model_copy(update={"source": "estimated", "confidence": 0.1})
    facts = {"wall_confidences": [0.9, 0.1, 0.9, 0.9], "ceiling_confidence": 0.9}
    planes = plane_map(ROOM, picture().geometry)  # type: ignore[arg-type]
    columns = [int(np.flatnonzero(planes[ROWS // 2] == FIRST_WALL + k).mean()) for k in range(4)]
    chair, table, bed = (patch(slice(18, 24), slice(c - 2, c + 2)) for c in (columns[2], columns[3], columns[1]))
    shadow = patch(slice(24, 27), slice(columns[3] - 1, columns[3] + 1))
    masks = {"target": chair | table | bed, "shadow": shadow}

    def given(asked: RemoveParameters, room: RoomModel = doubtful, **found: Any) -> StageContext:
        made = context(tmp_path, asked, room=room, **(masks | found))
        return replace(made, summary=lambda _stage: {"metrics": facts, "left_out": {}})

    part = RemoveParameters(trusted_walls=True)
    assert nothing_to_remove(given(part)) is None
    made = run(given(part))
    assert np.array_equal(np.asarray(made.artifacts["filled"]), chair | table)
    assert "walls 1, 3, 4 and the ceiling's height" in made.left_out[UNTRUSTED]
    reaches = patch(slice(24, 27), slice(min(columns[1], columns[2]) - 2, max(columns[1], columns[2]) + 2))
    joined = run(given(part, shadow=shadow | reaches))
    assert np.array_equal(np.asarray(joined.artifacts["filled"]), table), "a thing goes with its shadow or not at all"
    assert "only these" in str(nothing_to_remove(given(part, target=bed)))
    for asked, room in ((part, ROOM), (RemoveParameters(trusted_walls=True, doubtful_room=True), doubtful)):
        whole = run(given(asked, room))
        assert np.asarray(whole.artifacts["filled"]).sum() == masks["target"].sum()
        assert UNTRUSTED not in whole.left_out


def test_soft_shadow_is_lifted_beyond_the_target_and_the_page_says_so(tmp_path: Path) -> None:
    """A third of the light is missing in a strip beside the target: most of it comes back, nothing else moves."""
    maps, shape = plane_map(ROOM, Equirectangular(256, 128)), (128, 256)
    light = np.full((*shape, 3), 40.0, np.float32)
    columns = np.arange(256)[None, :]
    target = (maps == FLOOR) & (np.abs(columns - 128) < 8)
    shadow = (maps == FLOOR) & (np.abs(columns - 128) < 20) & ~target
    light[shadow] *= (0.67, 0.6, 0.5)
    gain = relit_gain(light, shadow, target, ROOM)
    inner = (maps == FLOOR) & (np.abs(columns - 128) < 14) & ~target
    inner[:90], inner[118:] = False, False
    lit = np.median((light * gain)[inner], axis=0)
    assert ((lit > 36) & (lit < 41)).all(), "also where things colour their shade"
    far = np.abs(columns - 128) > 60
    assert np.abs(np.broadcast_to(far, shape)[..., None] * (gain - 1)).max() < 0.05
    section = remove_section(picture(), np.zeros((ROWS, 2 * ROWS), bool), {"relit_share": 0.05})
    assert "5.0% of all directions" in section.text


def test_soft_shadow_is_lifted_in_nearly_one_tint() -> None:
    """Of a channel that falls off towards the shade, the fit beyond what is seen would make the floor blue."""
    maps, columns = plane_map(ROOM, Equirectangular(256, 128)), np.arange(256)[None, :]
    light = np.full((128, 256, 3), 40.0, np.float32)
    target = (maps == FLOOR) & (np.abs(columns - 128) < 8)
    shadow = (maps == FLOOR) & (np.abs(columns - 128) < 20) & ~target
    light[shadow] *= (0.67, 0.6, 0.3)
    lift = np.log2(relit_gain(light, shadow, target, ROOM))
    assert lift.max() > 0.4
    # The mean of three channels held so moves by a third of that at most.
    assert np.abs(lift - lift.mean(axis=-1, keepdims=True)).max() < 4 / 3 * MOST_TINT + 0.01
