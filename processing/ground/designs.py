"""Designs as text: each line names a shape, its material and its measures as expressions of the thing's size.

    low = 0.3 * h                                 a name for what follows
    pad fabric x=-X,X y=-Y,Y z=low,h edge=.04     a shape: verb, role of the material, measures
    @s:(-1,1) ?w>1 rod metal path=...             @name:values repeats a line, ?condition leaves it out
    rod $leg path=...                             the role is what was named leg before

Expressions know w, d, h (the size), X, Y (half of width and depth), what was named before, and some mathematics.
The texts are the package's own (`*.toml` beside the code), as trusted as its code.
"""

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from types import CodeType
from typing import Any

import numpy as np

from processing.ground.arrays import Vector

Verbs = Mapping[str, Callable[..., None]]
"""What makes a shape, by its name in the texts: called with the material's role and the measures."""

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
    "range_of": lambda low, high, step: np.arange(low, high, step).tolist(),
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


def build(
    text: str,
    size: Vector,
    verbs: Verbs,
    *,
    shared: Mapping[str, str] | None = None,
    names: Mapping[str, Any] | None = None,
) -> None:
    """Make a design: each line by its verb (role, measures); ``names`` are known from the beginning.

    A text of ``shared`` is a verb too: it knows its role as m, its measures, and what it is `given` where these were
    left out. `use` makes such a text in place: what it names is known after it, unless it is repeated.
    """
    w, d, h = size
    begin = {**_MATHS, "w": w, "d": d, "h": h, "X": w / 2, "Y": d / 2, **(names or {})}
    _Making(verbs, shared or {}, begin).run(text, dict(begin))


@dataclass(frozen=True)
class _Making:
    verbs: Verbs
    shared: Mapping[str, str]
    begin: dict[str, Any]

    def run(self, text: str, names: dict[str, Any]) -> None:
        for line in lines_of(text):
            for scope in _scopes(line.loops, names):
                if all(_value(code, scope) for code in line.conditions):
                    self._make(line, scope, {key: _value(code, scope) for key, code in line.values})

    def _make(self, line: Line, scope: dict[str, Any], values: dict[str, Any]) -> None:
        role = scope[line.role[1:]] if line.role.startswith("$") else line.role
        if line.verb == "=":
            scope |= values
        elif line.verb == "given":
            scope |= {key: value for key, value in values.items() if key not in scope}
        elif line.verb == "use":
            inner = dict(scope) if line.loops else scope
            inner |= values
            self.run(self.shared[line.role], inner)
        elif line.verb in self.shared:
            self.run(self.shared[line.verb], {**self.begin, **values, "m": role})
        else:
            self.verbs[line.verb](role, **values)


def _scopes(loops: tuple[tuple[str, CodeType], ...], names: dict[str, Any]) -> Iterator[dict[str, Any]]:
    if not loops:
        yield names
        return
    (name, code), *rest = loops
    for value in _value(code, names):
        yield from _scopes(tuple(rest), {**names, name: value})


def _value(code: CodeType, names: dict[str, Any]) -> Any:
    return eval(code, names)  # noqa: S307 (texts of this package alone)
