"""Views around the sphere: a network that is always right stays right, at the seam and at the poles too."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from processing.errors import ParameterError, SegmenterError
from processing.ground.arrays import Floats
from processing.segmentation.around import ViewPlan, fused, segment_around
from processing.segmentation.evidence import SceneClass, SceneEvidence
from processing.segmentation.segmenters import OnnxSegmenter, open_segmenter
from processing.sphere import Equirectangular, directions

COLOURS = np.array(
    [[0, 0, 0], [0, 255, 0], [0, 0, 255], [255, 0, 0], [255, 255, 0], [255, 0, 255], [0, 255, 255], [255, 255, 255]],
    np.uint8,
)
"""Corners of the colour cube: no mixture of two neighbours along an edge is near to a third."""


class ByColour:
    """Knows classes by their colours, and counts the views it was shown."""

    name = "by colour"
    size_px = 96
    fixed_size = False

    def __init__(self) -> None:
        self.views = 0

    def probabilities(self, view_rgb8: npt.NDArray[np.uint8]) -> Floats:
        self.views += 1
        off = np.abs(view_rgb8.astype(int)[..., None, :] - COLOURS.astype(int)).sum(axis=-1)
        return np.eye(len(SceneClass), dtype=np.float32)[off.argmin(axis=-1)]


def world(rows: int) -> npt.NDArray[np.int64]:
    """Classes of a room: floor, ceiling, walls; furniture across the seam, a tripod at the nadir, a window aside."""
    d, _ = directions(Equirectangular(2 * rows, rows))
    longitude, latitude = np.arctan2(d[..., 0], d[..., 1]), np.arcsin(d[..., 2])
    found = np.full(longitude.shape, int(SceneClass.WALL))
    found[latitude < -0.5] = SceneClass.FLOOR
    found[latitude > 0.6] = SceneClass.CEILING
    found[(np.abs(np.abs(longitude) - math.pi) < 0.5) & (np.abs(latitude + 0.4) < 0.3)] = SceneClass.FURNITURE
    found[(np.abs(longitude - 1.0) < 0.4) & (np.abs(latitude - 0.1) < 0.3)] = SceneClass.WINDOW
    found[latitude < -1.35] = SceneClass.TRIPOD
    return found


@pytest.mark.parametrize("skip", [False, True])
def test_a_perfect_network_stays_perfect(skip: bool) -> None:
    classes, network = world(128), ByColour()
    found = segment_around(COLOURS[world(256)], network, plan=ViewPlan(skip=skip), rows=128)
    np.testing.assert_allclose(found.probabilities.sum(axis=0), 1.0, rtol=1e-4)
    right = found.probabilities.argmax(axis=0) == classes
    weight = np.cos((0.5 - (np.arange(128) + 0.5) / 128) * math.pi)[:, None] * np.ones_like(right)
    # Edges are a pixel of the views wide, and there is a lot of edge.
    assert float((weight * right).sum() / weight.sum()) > 0.985
    assert right[:, [0, -1]].mean() > 0.95, "the seam"
    assert right[[0, -1]].all(), "the poles"
    assert found.views_used == network.views
    assert (found.views_skipped > 0) == skip


def test_labels_are_not_interpolated() -> None:
    """Between classes 0 and 2 there is no 1: no WALL appears between FLOOR and CEILING."""
    classes = np.where(world(256) == SceneClass.FLOOR, SceneClass.FLOOR, SceneClass.CEILING)
    found = segment_around(COLOURS[classes], ByColour(), plan=ViewPlan(skip=False), rows=64)
    assert set(np.unique(found.probabilities.argmax(axis=0))) <= {int(SceneClass.FLOOR), int(SceneClass.CEILING)}


def test_what_is_known_first_saves_views() -> None:
    known = np.full((len(SceneClass), 32, 64), 0.01, np.float32)
    known[SceneClass.CEILING] = 1 - 0.07
    first = SceneEvidence(known, "known")
    network = ByColour()
    found = segment_around(COLOURS[world(128)], network, first=first, rows=32)
    assert network.views == 0
    assert found.views_skipped == 19
    np.testing.assert_allclose(found.probabilities, known, atol=1e-3)
    assert found.notes[0].endswith("neither floor nor furniture and were covered by known")
    assert found.own is known, "an estimate made again goes by what the first one went by"


def test_what_is_known_first_is_spread_round_the_seam() -> None:
    """A small map that differs on both sides of the seam only: enlarged, both of its ends meet half-way."""
    known = np.full((len(SceneClass), 4, 8), 0.0, np.float32)
    known[SceneClass.CEILING], known[SceneClass.WALL, :, 0] = 1.0, 1.0
    known[SceneClass.CEILING, :, 0] = 0.0
    found = segment_around(COLOURS[world(64)], ByColour(), first=SceneEvidence(known, "known"), rows=32).probabilities
    wall = found[SceneClass.WALL, 16]
    # A step of 8 pixels: the last pixel of the row lies half a pixel before the seam.
    assert wall[-1] == pytest.approx(0.5 - 1 / 16, abs=0.01)
    assert wall[0] == pytest.approx(0.5 + 1 / 16, abs=0.01)


def test_pictures_that_are_no_panorama_are_refused() -> None:
    with pytest.raises(ParameterError):
        segment_around(np.zeros((8, 16), np.uint8), ByColour())  # type: ignore[arg-type]


def onnx_file(tmp_path: Path, **changes: object) -> Path:
    """Write a network that takes brightness for the class: a 1 x 1 convolution to two logits, at half the size."""
    import onnx

    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    weight = np.array([[[[1.0]], [[1.0]], [[1.0]]], [[[-1.0]], [[-1.0]], [[-1.0]]]], np.float32)
    graph = helper.make_graph(
        [
            helper.make_node("Conv", ["image", "w", "b"], ["full"], kernel_shape=[1, 1]),
            helper.make_node("AveragePool", ["full"], ["logits"], kernel_shape=[2, 2], strides=[2, 2]),
        ],
        "toy",
        [helper.make_tensor_value_info("image", kind, [1, 3, "h", "w"])],
        [helper.make_tensor_value_info("logits", kind, [1, 2, "h2", "w2"])],
        [
            helper.make_tensor("w", kind, [2, 3, 1, 1], weight.ravel()),
            helper.make_tensor("b", kind, [2], [-15.0, 15.0]),
        ],
    )
    path = tmp_path / "toy.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    contract = {"name": "toy", "input": "image", "size_px": 32, "fixed_size": False, "output": "logits"}
    contract |= {"outputs": ["logits"], "output_stride": 2, "classes": ["wall", "floor"], "std": [0.1, 0.1, 0.1]}
    path.with_suffix(".json").write_text(json.dumps(contract | changes))
    return path


def test_an_onnx_network_through_views(tmp_path: Path) -> None:
    network = open_segmenter(onnx_file(tmp_path), threads=1)
    assert isinstance(network, OnnxSegmenter)
    bright = np.zeros((64, 128, 3), np.uint8)
    bright[:32] = 255
    found = segment_around(bright, network, plan=ViewPlan(skip=False), rows=32)
    assert (found.probabilities[SceneClass.WALL, :14] > 0.99).all()
    assert (found.probabilities[SceneClass.FLOOR, 18:] > 0.99).all()


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"input": "pixels"}, "no pixels"),
        ({"outputs": ["scores"]}, "no scores"),
        ({"classes": ["wall", "floor", "bed"]}, "gives 2 classes"),
        ({"output_stride": 4}, "output is 16 x 16"),
        ({"layout": "NHWC"}, "rejects"),
    ],
)
def test_a_contract_that_is_not_kept_is_found_on_loading(
    tmp_path: Path, changes: dict[str, object], reported: str
) -> None:
    with pytest.raises(SegmenterError) as caught:
        open_segmenter(onnx_file(tmp_path, **changes), threads=1)
    assert reported in str(caught.value)


def test_files_that_are_no_network_are_refused(tmp_path: Path) -> None:
    good = onnx_file(tmp_path)
    good.write_bytes(b"version https://git-lfs.github.com/spec/v1\n")
    with pytest.raises(SegmenterError, match="cannot be loaded"):
        open_segmenter(good)
    with pytest.raises(SegmenterError, match="no such network"):
        open_segmenter(tmp_path / "none.onnx")
    with pytest.raises(SegmenterError, match="onnx or"):
        open_segmenter(tmp_path / "toy.pt")


@pytest.mark.shared("weights/deeplabv3_mnv2_pascal_quant.tflite")
def test_a_real_network_of_pascal_voc() -> None:
    """The published picture and its mask: fore- and background agree to 97 % at least (98.2 % is stated)."""
    from PIL import Image

    from benchmarks.room.detect_rivals import voc_segmenter
    from benchmarks.room.detect_truth import DATA

    network = voc_segmenter()
    assert network is not None
    with Image.open(DATA / "weights" / "bird_segmentation.bmp") as file:
        picture = np.asarray(file.convert("RGB").resize((513, 513), Image.Resampling.BILINEAR))
    with Image.open(DATA / "weights" / "bird_segmentation_mask.bmp") as file:
        mask = np.asarray(file.convert("L").resize((513, 513), Image.Resampling.NEAREST)) > 0
    found = network.probabilities(picture)
    # A bird is seen through a window.
    assert float(((found[..., SceneClass.WINDOW] > 0.9) == mask).mean()) > 0.97


def test_fused_evidence_is_the_mean_where_views_see_and_ours_elsewhere() -> None:
    """Ours says wall everywhere: what the other sees right is believed by half; straight up no view looks."""
    ours = np.zeros((len(SceneClass), 64, 128), np.float32)
    ours[SceneClass.WALL] = 1
    found = fused(SceneEvidence(ours, "ours", views_used=4), COLOURS[world(256)], ByColour())
    true = world(256)
    seen = true == SceneClass.FURNITURE
    assert np.median(found.probabilities[SceneClass.FURNITURE][seen]) == pytest.approx(0.5, abs=1e-3)
    np.testing.assert_allclose(found.probabilities[SceneClass.WALL][0], 1.0, atol=1e-3)
    assert (found.views_used, found.source) == (18, "ours, fused with by colour")
