"""Several exported networks in one file: the mean of their classes, their boundaries weighted by inverse variance.

Networks that were taught by other pictures, of another size, err in other places: their mean is better than each
(docs/reference/network.md). The program sees one network all the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import compose, helper, numpy_helper

OUTPUTS = ("probabilities", "columns", "details")


def join(networks: Sequence[Path], out: Path, *, name: str) -> None:
    """Write ``out`` and its page; details are the first network's, and so is the picture's size.

    A network of half that size is shown the mean of each four pixels. The pages' sigma scales become part of the graph.
    """
    models = [onnx.load(path) for path in networks]
    pages = [json.loads(path.with_suffix(".json").read_text("utf-8")) for path in networks]
    picture = models[0].graph.input[0]
    nodes: list[onnx.NodeProto] = []
    constants = [_constant("two", np.array(2.0)), _constant("count", np.array(float(len(models))))]
    constants.append(numpy_helper.from_array(np.array([2, 2, 1], np.int64), "parts"))
    for number, (model, page) in enumerate(zip(models, pages, strict=True)):
        part = compose.add_prefix(model, f"{number}/").graph
        same = _width(model.graph.input[0]) == _width(picture)
        change = ("Identity", {}) if same else ("AveragePool", {"kernel_shape": [2, 2], "strides": [2, 2]})
        nodes.append(helper.make_node(change[0], [picture.name], [part.input[0].name], **change[1]))
        nodes += [*part.node, *_weighted(f"{number}:", f"{number}/columns")]
        scale = np.array([page["ceiling_sigma_scale"], page["floor_sigma_scale"]]).reshape(1, 2, 1)
        constants += [*part.initializer, _constant(f"{number}:scale", scale)]
    nodes += _fused(len(models))
    wanted = [one for one in models[0].graph.output if one.name in OUTPUTS]
    graph = helper.make_graph(nodes, "room network", [picture], wanted, initializer=constants)
    made = helper.make_model(graph, opset_imports=models[0].opset_import, ir_version=models[0].ir_version)
    onnx.checker.check_model(made, full_check=True)
    data = made.SerializeToString()
    out.write_bytes(data)
    new = {
        "name": name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "ceiling_sigma_scale": 1.0,
        "floor_sigma_scale": 1.0,
    }
    out.with_suffix(".json").write_text(json.dumps(new, indent=2) + "\n", encoding="utf-8")


def _width(value: onnx.ValueInfoProto) -> int:
    return int(value.type.tensor_type.shape.dim[3].dim_value)


def _constant(name: str, values: np.ndarray) -> onnx.TensorProto:
    return numpy_helper.from_array(values.astype(np.float32), name)


def _weighted(prefix: str, columns: str) -> list[onnx.NodeProto]:
    """Return nodes from a network's columns to edges, variances, inverse variances and their products, and corners."""

    def node(kind: str, inputs: Sequence[str], output: str) -> onnx.NodeProto:
        return helper.make_node(kind, [name if name == "two" else prefix + name for name in inputs], [prefix + output])

    parts = [prefix + name for name in ("edges", "sigma", "corner")]
    return [
        helper.make_node("Split", [columns, "parts"], parts, axis=1),
        node("Mul", ("sigma", "scale"), "scaled"),
        node("Pow", ("scaled", "two"), "variance"),
        node("Reciprocal", ("variance",), "weight"),
        node("Mul", ("edges", "weight"), "heavy"),
    ]


def _fused(count: int) -> list[onnx.NodeProto]:
    """Return nodes that make one network's outputs of all: the variance is their mean one plus that between them."""
    each = [f"{number}:" for number in range(count)]
    nodes = [
        helper.make_node("Identity", ["0/details"], ["details"]),
        helper.make_node("Mean", [f"{number}/probabilities" for number in range(count)], ["probabilities"]),
        helper.make_node("Mean", [one + "corner" for one in each], ["corner"]),
        helper.make_node("Sum", [one + "weight" for one in each], ["weights"]),
        helper.make_node("Sum", [one + "heavy" for one in each], ["heavies"]),
        helper.make_node("Div", ["heavies", "weights"], ["edges"]),
        helper.make_node("Div", ["count", "weights"], ["within"]),
    ]
    for one in each:
        nodes += [
            helper.make_node("Sub", [one + "edges", "edges"], [one + "off"]),
            helper.make_node("Pow", [one + "off", "two"], [one + "square"]),
            helper.make_node("Mul", [one + "square", one + "weight"], [one + "apart"]),
        ]
    return [
        *nodes,
        helper.make_node("Sum", [one + "apart" for one in each], ["aparts"]),
        helper.make_node("Div", ["aparts", "weights"], ["between"]),
        helper.make_node("Add", ["within", "between"], ["variance"]),
        helper.make_node("Sqrt", ["variance"], ["sigma"]),
        helper.make_node("Concat", ["edges", "sigma", "corner"], ["columns"], axis=1),
    ]
