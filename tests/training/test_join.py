"""Several networks in one file answer with their mean."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx
import onnxruntime
import pytest
from onnx import numpy_helper, parser

from processing.segmentation.embedded import SHIPPED
from training.join import join

OUTPUTS = ["probabilities", "columns", "details"]


@cache
def answers(path: Path) -> list[npt.NDArray[np.float32]]:
    picture = np.random.default_rng(2).random((2, 3, 256, 512), np.float32)
    asked = onnxruntime.SessionOptions()
    asked.intra_op_num_threads = 1  # others wait by spinning
    session = onnxruntime.InferenceSession(path, asked, providers=["CPUExecutionProvider"])
    return [np.asarray(one) for one in session.run(OUTPUTS, {"picture": picture})]


def changed(folder: Path) -> Path:
    """Return the shipped network with other weights, and its page."""
    model = onnx.load(SHIPPED)
    for weights in model.graph.initializer:
        values = numpy_helper.to_array(weights)
        if values.dtype == np.float16 and values.ndim == 4:
            weights.CopyFrom(numpy_helper.from_array((values * np.float16(0.9)).astype(np.float16), weights.name))
    path = folder / "other.onnx"
    path.write_bytes(model.SerializeToString())
    path.with_suffix(".json").write_text(
        json.dumps({"name": "other", "sha256": "", "ceiling_sigma_scale": 0.5, "floor_sigma_scale": 0.25}), "utf-8"
    )
    return path


@pytest.mark.long
def test_classes_are_the_mean_and_boundaries_weighted_by_their_variance(tmp_path: Path) -> None:
    other, out = changed(tmp_path), tmp_path / "joined.onnx"
    join([SHIPPED, other], out, name="both")
    first, second, both = (answers(path) for path in (SHIPPED, other, out))
    assert not np.allclose(first[0], second[0])
    assert np.allclose(both[0], (first[0] + second[0]) / 2, atol=1e-6)
    assert np.array_equal(both[2], first[2])
    scales = np.array([[1.0, 1.0], [0.5, 0.25]])[:, None, :, None]
    edges = np.stack([first[1][:, :2], second[1][:, :2]]).astype(np.float64)
    variance = (np.stack([first[1][:, 2:4], second[1][:, 2:4]]) * scales) ** 2
    middle = (edges / variance).sum(axis=0) / (1 / variance).sum(axis=0)
    assert np.allclose(both[1][:, :2], middle, atol=1e-4)
    assert (both[1][:, 2:4] ** 2 >= variance.min(axis=0) * 0.999).all()
    page = json.loads(out.with_suffix(".json").read_text("utf-8"))
    assert (page["name"], page["ceiling_sigma_scale"], page["floor_sigma_scale"]) == ("both", 1.0, 1.0)


def test_a_network_of_half_the_size_sees_the_same_picture_coarsely(tmp_path: Path) -> None:
    small = tmp_path / "small.onnx"
    net = parser.parse_model(SMALL)
    onnx.save(net, small)
    small.with_suffix(".json").write_text(
        json.dumps({"name": "small", "sha256": "", "ceiling_sigma_scale": 1.0, "floor_sigma_scale": 1.0}), "utf-8"
    )
    out = tmp_path / "joined.onnx"
    join([SHIPPED, small], out, name="two sizes")
    first, both = answers(SHIPPED), answers(out)
    assert np.allclose(both[0], (first[0] + 0.125) / 2, atol=1e-6)


SMALL = """
<ir_version: 8, opset_import: ["" : 17]>
net (float[n,3,128,256] picture) => (float[n,8,128,256] probabilities, float[n,5,256] columns)
<float eighth = {0.125}, float[1] one = {1.0}, int64[3] shape = {-1, 5, 256}, int64[1] five = {5}>
{
  flat = ReduceMean <axes = [1], keepdims = 1> (picture)
  none = Sub (flat, flat)
  even = Add (none, eighth)
  probabilities = Concat <axis = 1> (even, even, even, even, even, even, even, even)
  line = ReduceMean <axes = [2], keepdims = 0> (none)
  sure = Add (line, one)
  columns = Concat <axis = 1> (line, line, sure, sure, line)
}
"""
