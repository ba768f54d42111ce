"""The built-in models: every design of every category, in any size within its limits, in the materials of a style.

Designs as text: each line names a shape, its material and its measures as expressions of the piece's size.

    low = 0.3 * h                                 a name for what follows
    pad fabric x=-X,X y=-Y,Y z=low,h edge=.04     a shape: verb, role of the material, measures
    @s:(-1,1) ?w>1 rod metal path=...             @name:values repeats a line, ?condition leaves it out

Expressions know w, d, h (the size), X, Y (half of width and depth), what was named before, and some mathematics.
The texts are the package's own (`*.toml` beside this file), as trusted as its code.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from types import CodeType
from typing import Any, NamedTuple

import numpy as np

from processing.errors import CatalogueError, ItemError
from processing.ground.tables import table_of
from processing.layout.furniture.bench import Bench
from processing.layout.furniture.model import FurnitureModel, Size
from processing.layout.furniture.styles import style_named
from processing.layout.furniture.verbs import VERBS

_MATHS: dict[str, Any] = {
    "__builtins__": {},
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "sqrt", "radians", "ceil", "pi", "hypot")},
    **{one.__name__: one for one in (min, max, abs, round, range, int)},
    "clip": lambda value, low, high: min(max(value, low), high),
    "mid": lambda count, k, low, high: low + (k + 0.5) * (high - low) / count,
    "ball": lambda r, low, high: tuple(
        (r * math.sin(math.pi * k / 16), (low + high) / 2 - (high - low) / 2 * math.cos(math.pi * k / 16))
        for k in range(17)
    ),
    "span": lambda a, b: (min(a, b), max(a, b)),
    "steps": lambda low, high, count: [float(v) for v in np.linspace(low, high, count)],
}


@dataclass(frozen=True)
class Line:
    """One line, its expressions compiled."""

    verb: str
    """`=` for a name."""
    role: str
    values: tuple[tuple[str, CodeType], ...]
    loops: tuple[tuple[str, CodeType], ...] = ()
    conditions: tuple[CodeType, ...] = ()


def _code(text: str) -> CodeType:
    return compile(ast.parse(text.strip(), mode="eval"), f"<{text}>", "eval")


@cache
def lines_of(text: str) -> tuple[Line, ...]:
    """Return the lines of a design."""
    return tuple(_line(row) for row in map(str.strip, text.splitlines()) if row and not row.startswith("#"))


def _line(row: str) -> Line:
    name, _, rest = row.partition(" = ")
    if rest and name.isidentifier():
        return Line("=", "", ((name, _code(rest)),))
    words = row.split()
    marks = [word for word in words if word[0] in "@?"]
    loops = tuple((name, _code(text)) for name, _, text in (m[1:].partition(":") for m in marks if m[0] == "@"))
    conditions = tuple(_code(m[1:]) for m in marks if m[0] == "?")
    verb, *others = words[len(marks) :]
    role = others.pop(0) if others and "=" not in others[0] else ""
    values = tuple((key, _code(text)) for key, _, text in (word.partition("=") for word in others))
    return Line(verb, role.replace("_", " "), values, loops, conditions)


def build(bench: Bench, text: str) -> None:
    """Make a design on a bench: each line by its verb (bench, role, values), `use` by a text that designs share.

    What such a text names is known after it, unless it is repeated.
    """
    w, d, h = bench.size
    chance: dict[str, Any] = {"rnd": lambda low, high: float(bench.rng.uniform(low, high))}
    _run(text, {**_MATHS, **chance, "w": w, "d": d, "h": h, "X": w / 2, "Y": d / 2}, bench)


def _run(text: str, names: dict[str, Any], bench: Bench) -> None:
    for line in lines_of(text):
        for scope in _scopes(line.loops, names):
            if not all(_value(code, scope) for code in line.conditions):
                continue
            values = {key: _value(code, scope) for key, code in line.values}
            if line.verb == "=":
                names |= values
            elif line.verb == "use":
                inner = {**scope, **values} if line.loops else names
                inner |= values
                _run(_designs()["shared"][line.role], inner, bench)
            else:
                VERBS[line.verb](bench, line.role, **values)


def _scopes(loops: tuple[tuple[str, CodeType], ...], names: dict[str, Any]) -> Iterator[dict[str, Any]]:
    if not loops:
        yield names
        return
    (name, code), *rest = loops
    for value in _value(code, names):
        yield from _scopes(tuple(rest), {**names, name: value})


def _value(code: CodeType, names: dict[str, Any]) -> Any:
    return eval(code, names)  # noqa: S307 (texts of this package alone)


@cache
def _designs() -> dict[str, Any]:
    """Return all designs: category -> {"sizes": [smallest, usual, largest], design: text}, and `shared` texts."""
    found: dict[str, Any] = {}
    shared: dict[str, str] = {}
    for name in ("seats", "cases", "tables", "decor"):
        table = dict(table_of(__package__, name))
        shared |= table.pop("shared", {})
        found |= table
    return {**found, "shared": shared}


LICENCE = "Apache-2.0 (part of daylit)"


class Kind(NamedTuple):
    """A category's sizes in metres, and its designs."""

    smallest_m: Size
    usual_m: Size
    largest_m: Size
    designs: dict[str, str]


def _kind(tables: dict[str, Any], row: dict[str, Any]) -> Kind:
    smallest, usual, largest = (tuple(size) for size in row["sizes"])
    texts = tables[row["like"]] if "like" in row else row
    return Kind(smallest, usual, largest, {name: text for name, text in texts.items() if name not in ("sizes", "like")})


BUILT_IN: dict[str, Kind] = {name: _kind(_designs(), row) for name, row in _designs().items() if name != "shared"}


def checked_size(category: str, size_m: Size | None) -> Size:
    """Return a size within the kind's limits, its usual one for None; raise `CatalogueError` for others."""
    kind = BUILT_IN[category]
    size = kind.usual_m if size_m is None else size_m
    rows = zip(("wide", "deep", "high"), size, kind.smallest_m, kind.largest_m, strict=True)
    for word, value, low, high in rows:
        if not low - 1e-6 <= value <= high + 1e-6:
            raise CatalogueError(f"{value:g} m {word}: it is made {low:g} to {high:g} m {word}", where=category)
    return size


def design_of(category: str, style: str) -> str:
    """Return the name of the design that a style has of a category: its own, else the first."""
    texts, chosen = BUILT_IN[category].designs, style_named(style).designs
    of = next((name for name in (category, category.split()[-1]) if chosen.get(name) in texts), "")
    return chosen[of] if of else next(iter(texts))


@lru_cache(maxsize=64)
def build_model(category: str, style: str, size_m: Size | None = None, design: str = "") -> FurnitureModel:
    """Return a built-in model, in a style's design or another; the same arguments give the same triangles."""
    size = checked_size(category, size_m)
    name = design or design_of(category, style)
    if name not in BUILT_IN[category].designs:
        raise ItemError(f"no design '{name[:40]}'; there are: {', '.join(BUILT_IN[category].designs)}", where=category)
    bench = Bench(size, style_named(style), np.random.default_rng(sum(category.encode())))
    build(bench, BUILT_IN[category].designs[name])
    return FurnitureModel(f"{category}/{style}", category, bench.parts(), size, LICENCE, notes=(f"design {name}",))
