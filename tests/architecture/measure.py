"""Figures of the house's structure, a row a room, as Markdown: ``python -m tests.architecture.measure [FOLDER]``.

FOLDER: the checkout to measure, by default this one. Module functions that are used once are named in one place of the
product beside their definition; of public functions whose signature names an array it is counted how many docstrings
state a shape, and how many a unit as well.
"""

from __future__ import annotations

import ast
import math
import re
import sys
from collections import Counter
from pathlib import Path
from typing import NamedTuple

ROOMS = ("drivers", "mocks", "station", "processing", "studio")
_ARRAY = re.compile(r"ndarray|NDArray|Halves|Floats|Doubles|Reals|Flags|Bools|Bytes|Indices|Array|U?Int\d+s")
_SHAPE = re.compile(r"\([A-Z][\w, *]*\)|shape")
_UNIT = re.compile(
    r"\b(cd/m2|lm/m2|lx|lux|metres?|m|mm|cm|rad|radians?|degrees?|px|pixels?|stops?|seconds?|s|sr|share|relative|"
    r"0\.\.1|bool|mask|codes?|sRGB|linear|unit|any scale|probabilit\w+|labels?|indices|numbers?|"
    r"radiance|irradiance|albedo)\b"
    r"|_(cd_m2|lx|m|rad|deg|px|s|stops|sr|frac|share|m2|mm)\b"
)
_ALIAS = re.compile(r"^\w+(?:: TypeAlias)? = (?:npt\.)?NDArray\[np\.\w+\]$", re.M)
_TOLD = re.compile(r"\b(told|tells?)\b", re.I)


class Figures(NamedTuple):
    """What a room is counted by."""

    lines: int
    files: int
    folders: int
    fullest: int
    once_pct: float
    parameters: int
    aliases: int
    told: int
    shapes_pct: float
    units_pct: float


HEAD = (
    "lines | files | folders | fullest folder | functions used once | longest parameter list | aliases of array types "
)
HEAD += "| forbidden words | array functions with shapes | and units"


def figures(paths: list[Path], words: Counter[str]) -> Figures:
    """Return the figures of some files; ``words``: how often each name stands in the whole product."""
    texts = [path.read_text("utf-8") for path in paths]
    once, functions, arrays, shaped, united, longest = 0, 0, 0, 0, 0, 0
    for text in texts:
        tree = ast.parse(text)
        names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
        functions += len(names)
        once += sum(words[name] == 2 for name in names)
        for node in ast.walk(tree):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            a = node.args
            longest = max(longest, len(a.posonlyargs) + len(a.args) + len(a.kwonlyargs))
            signature = ast.unparse(a) + (ast.unparse(node.returns) if node.returns else "")
            if node.name.startswith("_") or not _ARRAY.search(signature):
                continue
            doc = ast.get_docstring(node) or ""
            arrays += 1
            shaped += bool(_SHAPE.search(doc))
            united += bool(_SHAPE.search(doc) and _UNIT.search(doc + signature))
    folders = Counter(path.parent for path in paths)
    return Figures(
        sum(text.count("\n") for text in texts),
        len(paths),
        len(folders),
        max(folders.values()),
        100 * once / max(functions, 1),
        longest,
        sum(len(_ALIAS.findall(text)) for text in texts),
        sum(len(_TOLD.findall(text)) for text in texts),
        100 * shaped / arrays if arrays else math.nan,
        100 * united / arrays if arrays else math.nan,
    )


def table(root: Path) -> str:
    """Return a row a room, and one of the product, as Markdown."""
    rooms = {room: sorted((root / room).rglob("*.py")) for room in ROOMS}
    whole = [path for paths in rooms.values() for path in paths] + [root / "daylit.py"]
    words: Counter[str] = Counter()
    for path in whole:
        words.update(re.findall(r"[A-Za-z_]\w*", path.read_text("utf-8")))
    rows = [f"| room | {HEAD} |", "| --- " * (len(Figures._fields) + 1) + "|"]
    for name, paths in (*rooms.items(), ("product", whole)):
        if paths:
            found = figures(paths, words)
            shown = (
                "-" if isinstance(v, float) and math.isnan(v) else f"{v:.0f} %" if isinstance(v, float) else f"{v:,}"
                for v in found
            )
            rows.append(f"| {name} | {' | '.join(shown)} |")
    return "\n".join(rows)


if __name__ == "__main__":
    sys.stdout.write(table(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).resolve().parents[2]) + "\n")
