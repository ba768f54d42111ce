"""Two networks in one file answer as each of them alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx
import onnxruntime
from onnx import numpy_helper

from processing.segmentation.embedded import SHIPPED
from training.join import join

OUTPUTS = ["probabilities", "columns"]


def answers(path: Path) -> list[npt.NDArray[np.float32]]:
    picture = np.random.default_rng(2).random((2, 3, 128, 256), np.float32)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
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


def test_classes_are_of_the_one_and_boundaries_of_the_other(tmp_path: Path) -> None:
    other, out = changed(tmp_path), tmp_path / "joined.onnx"
    join(SHIPPED, other, out, name="both")
    first, second, both = (answers(path) for path in (SHIPPED, other, out))
    assert not np.allclose(first[0], second[0])
    assert not np.allclose(first[1], second[1])
    assert np.array_equal(both[0], first[0])
    assert np.array_equal(both[1], second[1])
    page = json.loads(out.with_suffix(".json").read_text("utf-8"))
    assert (page["name"], page["ceiling_sigma_scale"], page["floor_sigma_scale"]) == ("both", 0.5, 0.25)
