"""Makes the tiny ONNX files beside it: networks with the inputs and outputs of layout networks, and fixed answers.

Run by hand, with the package onnx: ``python tests/processing/room/networks/make_networks.py``. Each answers with the
boundaries of one box, plus 0 times the mean of the picture, so that the input is used.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HERE = Path(__file__).parent
HALF_X, HALF_Y, RATIO = 1.5, 1.0, 0.6
"""Of the box, in camera heights; ahead is y."""


def distances(count: int) -> np.ndarray:
    azimuth = ((np.arange(count) + 0.5) / count - 0.5) * 2 * math.pi
    return np.minimum(HALF_X / np.abs(np.sin(azimuth)), HALF_Y / np.abs(np.cos(azimuth)))


def save(name: str, answers: dict[str, np.ndarray], size: tuple[int, ...] = (1, 3, 512, 1024)) -> None:
    nodes = [
        helper.make_node("ReduceMean", ["x"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
    ]
    constants = [numpy_helper.from_array(np.zeros((), np.float32), "zero")]
    outputs = []
    for key, values in answers.items():
        constants.append(numpy_helper.from_array(values.astype(np.float32), f"{key}_answer"))
        nodes.append(helper.make_node("Add", [f"{key}_answer", "nothing"], [key]))
        outputs.append(helper.make_tensor_value_info(key, TensorProto.FLOAT, values.shape))
    picture = helper.make_tensor_value_info("x", TensorProto.FLOAT, size)
    graph = helper.make_graph(nodes, name, [picture], outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    onnx.save(model, HERE / f"{name}.onnx")


def main() -> None:
    wide, narrow = distances(1024), distances(256)
    up, down = np.arctan(RATIO / wide), np.arctan(1 / wide)
    corner = np.full((1, 1, 1024), -4.0)
    corner[0, 0, ::256] = 4.0
    save("horizonnet", {"bon": np.stack([-up, down])[None], "cor": corner})
    save("led2net", {"output": np.stack([up, -down])[None]})
    save("lgtnet", {"depth": narrow[None], "ratio": np.array([[RATIO]])})
    save("pixels", {"output": np.stack([100 * up, -100 * down])[None]})
    save("classifier", {"logits": np.zeros((1, 1000))}, (1, 3, 224, 224))


if __name__ == "__main__":
    main()
