"""Contracts of networks: three kinds of output become our classes, and what does not fit is refused by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from processing.errors import SegmenterError
from processing.segmentation.adapters import NetworkContract, network_input, read_contract, scene_probabilities
from processing.segmentation.evidence import SceneClass

NAMES = ["wall", "floor", "bed", "curtain"]
OURS = [SceneClass.WALL, SceneClass.FLOOR, SceneClass.FURNITURE, SceneClass.FIXTURE]
TRUE = np.array([[0, 1, 2, 3], [3, 2, 1, 0]])
MANY = {f"wall {k}": "wall" for k in range(300)}
GOOD: dict[str, Any] = {
    "name": "toy",
    "input": "x",
    "size_px": 16,
    "classes": NAMES,
    "output": "logits",
    "outputs": ["y"],
}


def contract(**changes: Any) -> NetworkContract:
    return NetworkContract.model_validate_json(json.dumps(GOOD | changes))


def scores(classes: int = 4, shift: int = 0) -> npt.NDArray[np.float32]:
    """Logits (1, C, 2, 4) that say `TRUE`."""
    return (20.0 * np.eye(classes, dtype=np.float32)[TRUE + shift]).transpose(2, 0, 1)[None]


def result(found: npt.NDArray[np.float32]) -> list[list[int]]:
    np.testing.assert_allclose(found.sum(axis=-1), 1.0, rtol=1e-5)
    return [[int(v) for v in row] for row in found.argmax(axis=-1)]


EXPECTED = [[int(OURS[i]) for i in row] for row in TRUE]


def test_logits_channels_first_and_last() -> None:
    assert result(scene_probabilities(contract(), [scores()], (2, 4))) == EXPECTED
    last = contract(layout="NHWC")
    assert result(scene_probabilities(last, [scores().transpose(0, 2, 3, 1)], (2, 4))) == EXPECTED


def test_probabilities() -> None:
    share = np.eye(4, dtype=np.float32)[TRUE].transpose(2, 0, 1)[None]
    assert result(scene_probabilities(contract(output="probabilities"), [share], (2, 4))) == EXPECTED
    with pytest.raises(SegmenterError, match="below 0"):
        scene_probabilities(contract(output="probabilities"), [share - 1], (2, 4))


@pytest.mark.parametrize("labels", [TRUE[None], TRUE[None, None], TRUE[None, ..., None], TRUE.astype(np.int64)])
def test_argmax(labels: npt.NDArray[np.int64]) -> None:
    assert result(scene_probabilities(contract(output="argmax"), [labels], (2, 4))) == EXPECTED


def test_pixels_without_a_class_stay_open() -> None:
    labels = TRUE.copy()
    labels[0, 0] = 255
    found = scene_probabilities(contract(output="argmax"), [labels[None]], (2, 4))
    np.testing.assert_allclose(found[0, 0], 1 / len(SceneClass))


def test_a_class_numbered_255_is_no_open_pixel_where_there_are_so_many_classes() -> None:
    many = contract(output="argmax", classes=[*NAMES, *(f"wall {k}" for k in range(300))], meanings=MANY)
    found = scene_probabilities(many, [np.full((1, 2, 4), 255)], (2, 4))
    np.testing.assert_array_equal(found.argmax(axis=-1), SceneClass.WALL)


def test_queries() -> None:
    """Five queries: one a class with its mask, one of no object that covers everything."""
    classes = np.vstack([20 * np.eye(5, dtype=np.float32)[:4], 20 * np.eye(5, dtype=np.float32)[4:]])
    masks = np.stack([np.where(i == TRUE, 9.0, -9.0) for i in range(4)] + [np.full(TRUE.shape, 9.0)]).astype(np.float32)
    queries = contract(output="queries", outputs=["c", "m"])
    assert result(scene_probabilities(queries, [classes[None], masks[None]], (2, 4))) == EXPECTED
    with pytest.raises(SegmenterError, match="queries with"):
        scene_probabilities(queries, [classes[None, :3], masks[None]], (2, 4))


def test_labels_that_were_not_reduced_are_reported_not_shifted() -> None:
    """One class more (0 is "other") would move every name by one."""
    with pytest.raises(SegmenterError, match="gives 5 classes") as caught:
        scene_probabilities(contract(), [scores(5, 1)], (2, 4))
    assert "off by one" in caught.value.likely
    assert result(scene_probabilities(contract(first_label=1), [scores(5, 1)], (2, 4))) == EXPECTED
    with pytest.raises(SegmenterError, match="class number 4"):
        scene_probabilities(contract(output="argmax"), [TRUE[None] + 1], (2, 4))
    found = scene_probabilities(contract(output="argmax", first_label=1), [TRUE[None] + 1], (2, 4))
    assert result(found) == EXPECTED


def test_other_is_unknown_where_labels_are_not_reduced() -> None:
    found = scene_probabilities(contract(output="argmax", first_label=1), [np.zeros((1, 2, 4), int)], (2, 4))
    np.testing.assert_allclose(found, 1 / len(SceneClass))


@pytest.mark.parametrize("size", [(8, 4), (2, 16)])
def test_a_wrong_stride_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(SegmenterError, match="output is 2 x 4"):
        scene_probabilities(contract(), [scores()], size)
    assert result(scene_probabilities(contract(output_stride=4), [scores()], (8, 16))) == EXPECTED


def test_wrong_shapes_and_values_are_refused() -> None:
    with pytest.raises(SegmenterError, match="shape"):
        scene_probabilities(contract(), [scores()[0, 0]], (2, 4))
    bad = scores()
    bad[0, 0, 0, 0] = np.nan
    with pytest.raises(SegmenterError, match="NaN"):
        scene_probabilities(contract(), [bad], (2, 4))
    with pytest.raises(SegmenterError, match="not whole"):
        scene_probabilities(contract(output="argmax"), [TRUE[None] + 0.5], (2, 4))


def test_input_is_fed_as_declared() -> None:
    view = np.zeros((2, 4, 3), np.uint8)
    view[..., 0], view[..., 2] = 255, 51
    fed = network_input(contract(mean=[0.5, 0, 0], std=[0.5, 1, 1]), view)
    assert fed.shape == (1, 3, 2, 4)
    np.testing.assert_allclose(fed[0, :, 0, 0], [1.0, 0.0, 0.2], rtol=1e-6)
    raw = network_input(contract(order="BGR", layout="NHWC", input_type="uint8", input_range=255), view)
    assert raw.dtype == np.uint8
    assert raw[0, 0, 0].tolist() == [51, 0, 255]
    np.testing.assert_allclose(network_input(contract(input_range=255), view)[0, :, 0, 0], [255, 0, 51])


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"size_px": 100, "size_multiple": 32}, "multiple"),
        ({"output": "queries"}, "two outputs"),
        ({"std": [0, 1, 1]}, "std"),
        ({"input_type": "uint8"}, "uint8"),
        ({"classes": "coco"}, "classes"),
        ({"classes": ["wall", "unicorn"]}, "unicorn"),
        ({"colour": 1}, "colour"),
        ({"first_label": 2}, "first_label"),
    ],
)
def test_a_wrong_contract_is_refused_on_reading(tmp_path: Path, changes: dict[str, Any], reported: str) -> None:
    path = tmp_path / "network.json"
    path.write_text(json.dumps(GOOD | changes))
    with pytest.raises(SegmenterError) as caught:
        read_contract(path)
    assert reported in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"name": 1, "name": 2}'])
def test_damaged_contracts_are_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "network.json"
    path.write_text(text)
    with pytest.raises(SegmenterError):
        read_contract(path)
    with pytest.raises(SegmenterError, match="cannot be read"):
        read_contract(tmp_path / "none.json")


def test_own_names_may_be_given_a_meaning() -> None:
    own = contract(classes=["wall", "unicorn", "stuff"], meanings={"unicorn": "furniture", "stuff": ["floor", "wall"]})
    assert own.matrix[1, SceneClass.FURNITURE] == 1
    assert own.matrix[2, SceneClass.FLOOR] == own.matrix[2, SceneClass.WALL] == 0.5
