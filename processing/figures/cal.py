"""Radiance's .cal files, as pcomb applies them to a picture: factors of the channels, and fall-off by place.

The file's own expressions are worked out at the picture's pixels (calcomp: -a^b is (-a)^b; a / 0 and the like are 0).
Pixel numbers (`x - 1806`) are of a square picture that the image circle fills; those centred on 500 are LumiLab's, of
pictures turned into equidistant ones before.
"""

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from processing.errors import PictureFileError
from processing.ground.arrays import Doubles, Floats
from processing.sphere import Fisheye
from processing.sphere.geometry import polar_of_radius

MOST_CHARACTERS, MOST_STEPS = 100_000, 20_000  # chosen: people's files have a hundredth of it
TURNED_PX = 500.0  # half the side of LumiLab's equidistant pictures
ANY_PX, OTHER_PX = 2048.0, 1500.0  # halves of sides, chosen: without pixel numbers a file says the same at both
PIXELS = 1e-3  # relative, chosen: pcomb counts from a pixel's corner, which is half a pixel at these sizes
FALLOFF = 50.0  # times; chosen: no lens falls off so far
_OPERATORS = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power}
_NUMPY = {"acos": "arccos", "asin": "arcsin", "atan": "arctan", "atan2": "arctan2", "min": "minimum", "max": "maximum"}
_NUMPY |= {name: name for name in ("sin", "cos", "tan", "sqrt", "exp", "log", "log10", "ceil", "floor", "abs")}
_Definitions = Mapping[tuple[str, int], tuple[list[str], ast.expr]]


def _definitions(text: str) -> _Definitions:
    """Return by name and number of arguments their names and the expression, in Python's grammar; names end in _."""
    text = re.sub(r"(?<![\w.])[A-Za-z]\w*", r"\g<0>_", "".join(re.sub(r"\{[^}]*\}", "", text).split()))
    found = {}
    for statement in filter(None, text.replace("^", "**").split(";")):
        if not (match := re.fullmatch(r"(\w+)(?:\(([\w,]*)\))?[=:]([^#]+)", statement)):
            raise ValueError(f"{statement[:40]} defines nothing")
        names = match[2].split(",") if match[2] else []
        found[match[1], len(names)] = names, ast.parse(match[3], mode="eval").body
    return found


class _Evaluation:
    """The values of a file's names, of which ``found`` are known; ``middles``: what x and y are less."""

    def __init__(self, definitions: _Definitions, found: dict[str, Any]) -> None:
        self.definitions, self.middles, self.steps = definitions, set[float](), 0
        self.found = {name: value for name, value in found.items() if (name, 0) not in definitions}

    def value(self, node: ast.expr, local: Mapping[str, Any]) -> Any:
        """Return a number or an array of the places' shape; `ValueError` says what cannot be worked out."""
        self.steps += 1
        if self.steps > MOST_STEPS:
            raise ValueError("it does not end")
        match node:
            case ast.Constant(value=int() | float() as number):
                return float(number)
            case ast.UnaryOp(ast.USub(), ast.BinOp(base, ast.Pow(), by) as at) if at.col_offset == node.col_offset + 1:
                return _worked_out(np.power, -self.value(base, local), self.value(by, local))
            case ast.UnaryOp(ast.USub(), operand):
                return -self.value(operand, local)
            case ast.BinOp(left, sign, right) if type(sign) in _OPERATORS:
                first, second = self.value(left, local), self.value(right, local)
                for place, middle in ((first, second), (second, first)) if isinstance(sign, ast.Sub) else ():
                    if any(place is self.found.get(name) for name in ("x_", "y_")):
                        self.middles |= {float(np.max(middle))}
                return _worked_out(_OPERATORS[type(sign)], first, second)
            case ast.Name(id=word) | ast.Call(ast.Name(id=word), _, []):
                values = [self.value(one, local) for one in getattr(node, "args", ())]
                return local[word] if word in local and not values else self._named(word, values)
        raise ValueError(f"{ast.unparse(node)} is not Radiance's")

    def _named(self, word: str, values: list[Any]) -> Any:
        if word in ("ri_", "gi_", "bi_"):
            if len(values) != 1 or np.any(values[0] != 1):
                raise ValueError("it moves pixels (use --view for that) or combines pictures")
            return self.found[word]
        if word in self.found and not values:
            return self.found[word]
        if (word, len(values)) in self.definitions:
            names, body = self.definitions[word, len(values)]
            value = self.value(body, dict(zip(names, values, strict=True)))
            return value if values else self.found.setdefault(word, value)
        if word == "if_" and len(values) == 3:
            return np.where(values[0] > 0, values[1], values[2])
        function = getattr(np, _NUMPY.get(word[:-1], ""), None)
        if function is None or function.nin != len(values):
            raise ValueError(f"{word[:-1]} of {len(values)} arguments is not known")
        return _worked_out(function, *values)


def _worked_out(function: np.ufunc, *values: Any) -> Doubles:
    found = function(*values)
    return found if function in (np.add, np.subtract, np.multiply) else np.where(np.isfinite(found), found, 0.0)


@dataclass(frozen=True)
class CalFile:
    """What a .cal file does."""

    definitions: _Definitions
    half_px: float = ANY_PX
    """Half the side of the square picture that its pixel numbers are of."""
    varies: bool = False
    """Whether the factors depend on the place; then they are a lens's."""
    gains: tuple[float, ...] = (1.0, 1.0, 1.0)
    """The factors in the middle."""

    def factors(self, geometry: Fisheye) -> Floats:
        """Return the factor of each pixel and channel (H, W, 3) of a fisheye picture; outside the circle its edge's."""
        across, down = (one / geometry.radius_px for one in geometry.offsets_px())
        r, knots = np.hypot(across, down), np.linspace(0, 1, 2049)
        # Of the field's half: the angle from the axis at these distances.
        turned = np.arctan2(*polar_of_radius(geometry, knots)) / geometry.half_field_rad
        reached = np.interp(r, knots, turned if self.half_px == TURNED_PX else knots) / np.maximum(r, 1e-9)
        return np.moveaxis(self.evaluated(across * reached, -down * reached)[0], 0, -1).astype(np.float32)

    def evaluated(self, across: Doubles, up: Doubles, colour: float = 1.0) -> tuple[Doubles, _Evaluation]:
        """Return what becomes of red ``colour``, green its square, blue its cube (3, ...), and the values on the way.

        Of places of any shape, in radii right of and above the middle. Raises `ValueError` saying what cannot be done.
        """
        found: dict[str, Any] = dict.fromkeys(("xmax_", "ymax_", "xres_", "yres_"), 2 * self.half_px)
        found |= {"x_": self.half_px * (1 + across), "y_": self.half_px * (1 + up), "PI_": math.pi}
        run = _Evaluation(self.definitions, found | {"ri_": colour, "gi_": colour**2, "bi_": colour**3})
        with np.errstate(all="ignore"):
            channels = [run.value(ast.Name(name), {}) for name in ("ro_", "go_", "bo_")]
        return np.stack(np.broadcast_arrays(*channels, across + up)[:3]), run


def text_of(path: Path) -> str:
    """Return the text of a small file of another program; `PictureFileError` where it cannot be read."""
    try:
        return path.read_text("utf-8-sig", errors="replace")[:MOST_CHARACTERS]
    except OSError as error:
        raise PictureFileError(f"cannot be read ({error.strerror})", where=path.name) from error


def read_cal(path: Path) -> CalFile:
    """Read a file that multiplies each channel by factors above 0, the same everywhere or those of a lens's fall-off.

    Raises `PictureFileError` for a file that does anything else, with what that is.
    """
    text = text_of(path)
    try:
        return _checked(CalFile(_definitions(text)))
    except (ValueError, SyntaxError, RecursionError, MemoryError) as error:
        what, advice = f"cannot be applied as pcomb does: {error}", "ro, go and bo: ri(1), gi(1) and bi(1) by factors"
        raise PictureFileError(what, where=path.name, advice=advice) from error


def _checked(cal: CalFile) -> CalFile:
    """Return the file with its picture's size and its factors in the middle; `ValueError` says what does not fit."""
    line = np.linspace(0, math.sqrt(0.5), 33)  # from the middle to the circle's edge, by both x and y
    plain, run = cal.evaluated(line, line)
    if not np.allclose(cal.evaluated(line, line, 2.0)[0].T, plain.T * (2, 4, 8), rtol=1e-9, atol=0):
        raise ValueError("it does not scale each channel separately")
    cal = replace(cal, half_px=max(min(run.middles, default=ANY_PX), 1.0))
    plain, run = cal.evaluated(line, line)
    other = replace(cal, half_px=OTHER_PX).evaluated(line, line)[0] if cal.half_px == ANY_PX else plain
    off, edge = max((abs(one - cal.half_px) for one in run.middles), default=0), np.max(run.found.get("r_", 1.0))
    if off > 1 or not np.allclose(other, plain, PIXELS) or 0.02 < abs(edge - 1) < 0.25:
        seen = f"N is {sorted(run.middles) or 'not there'}, r at the edge {edge:.3g}"
        raise ValueError(f"it is by x - N and y - N for no square of 2 N pixels that the circle fills: {seen}")
    if not (plain.min() > 0 and plain.max() < math.inf and np.ptp(np.log(plain), axis=1).max() < math.log(FALLOFF)):
        raise ValueError(f"its factors are {plain.min():.3g} to {plain.max():.3g}")
    return replace(cal, varies=bool(np.ptp(plain, axis=1).max() > 0), gains=tuple(plain[:, 0].tolist()))
