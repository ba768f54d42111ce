"""Two checkpoints' networks in one file: classes of one, boundaries of the other.

What is learnt last gains one and may lose the other (docs/reference/network.md); the program sees one network all
the same.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import onnx
from onnx import compose, helper, utils

PICTURE, CLASSES, COLUMNS = "picture", "probabilities", "columns"


def join(classes: Path, boundaries: Path, out: Path, *, name: str) -> None:
    """Write ``out`` and its page from two exported networks; the sigma scales are those of the boundaries'."""
    parts = [_part(classes, CLASSES, "classes/"), _part(boundaries, COLUMNS, "boundaries/")]
    nodes = [helper.make_node("Identity", [PICTURE], [f"{prefix}{PICTURE}"]) for prefix in ("classes/", "boundaries/")]
    graph = helper.make_graph(
        [*nodes, *parts[0].graph.node, *parts[1].graph.node],
        "room network",
        [onnx.load(classes).graph.input[0]],
        [_named(parts[0], CLASSES), _named(parts[1], COLUMNS)],
        initializer=[*parts[0].graph.initializer, *parts[1].graph.initializer],
    )
    graph.node.extend(
        [
            helper.make_node("Identity", [f"classes/{CLASSES}"], [CLASSES]),
            helper.make_node("Identity", [f"boundaries/{COLUMNS}"], [COLUMNS]),
        ]
    )
    model = helper.make_model(graph, opset_imports=parts[0].opset_import, ir_version=parts[0].ir_version)
    onnx.checker.check_model(model, full_check=True)
    data = model.SerializeToString()
    out.write_bytes(data)
    scales = json.loads(boundaries.with_suffix(".json").read_text("utf-8"))
    page = scales | {"name": name, "sha256": hashlib.sha256(data).hexdigest()}
    out.with_suffix(".json").write_text(json.dumps(page, indent=2) + "\n", encoding="utf-8")


def _part(path: Path, output: str, prefix: str) -> onnx.ModelProto:
    """Return what of a network leads to one output, all names prefixed."""
    needed = utils.Extractor(onnx.load(path)).extract_model([PICTURE], [output])
    return compose.add_prefix(needed, prefix)


def _named(part: onnx.ModelProto, name: str) -> onnx.ValueInfoProto:
    """Return a part's output under its own name, its batch dimension that of the picture."""
    info = onnx.ValueInfoProto()
    info.CopyFrom(part.graph.output[0])
    info.name = name
    info.type.tensor_type.shape.dim[0].dim_param = "n"
    return info
