"""From a checkpoint to the ONNX file that the program ships: weights in half precision, a page about it beside it."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper

from training.network import HEIGHT, WIDTH, RoomNetwork, Shipped

OPSET = 17
LEAST_VALUES = 64
"""Constants smaller than this stay as they are."""


def export(checkpoint: Path, out: Path, *, name: str, sigma_scale: tuple[float, float]) -> None:
    """Write ``out`` and the JSON beside it; ``sigma_scale`` (ceiling, floor) calibrates the boundaries' uncertainty."""
    network = RoomNetwork()
    network.load_state_dict(torch.load(checkpoint, weights_only=True)["average"])
    shipped = Shipped(network).eval()
    held = io.BytesIO()
    torch.onnx.export(
        shipped,
        (torch.zeros(2, 3, HEIGHT, WIDTH),),
        held,  # type: ignore[arg-type]
        input_names=["picture"],
        output_names=["probabilities", "columns", "details"],
        dynamic_axes={name: {0: "n"} for name in ("picture", "probabilities", "columns", "details")},
        opset_version=OPSET,
        dynamo=False,
    )
    model = halved(onnx.load_from_string(held.getvalue()))
    onnx.checker.check_model(model, full_check=True)
    data = model.SerializeToString()
    out.write_bytes(data)
    page = {
        "name": name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "ceiling_sigma_scale": round(sigma_scale[0], 3),
        "floor_sigma_scale": round(sigma_scale[1], 3),
    }
    out.with_suffix(".json").write_text(json.dumps(page, indent=2) + "\n", encoding="utf-8")


def halved(model: onnx.ModelProto) -> onnx.ModelProto:
    """Return the model with its large float constants kept in half precision; all is computed in single precision."""
    graph = model.graph
    casts, kept = [], []
    for constant in graph.initializer:
        values = numpy_helper.to_array(constant)
        if values.dtype != np.float32 or values.size < LEAST_VALUES:
            kept.append(constant)
            continue
        kept.append(numpy_helper.from_array(values.astype(np.float16), f"{constant.name}.half"))
        casts.append(helper.make_node("Cast", [f"{constant.name}.half"], [constant.name], to=TensorProto.FLOAT))
    del graph.initializer[:]
    graph.initializer.extend(kept)
    nodes = list(graph.node)
    del graph.node[:]
    graph.node.extend([*casts, *nodes])
    return model
