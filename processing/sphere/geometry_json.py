"""Geometries as plain JSON values, as picture files and results keep them."""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Mapping
from typing import Any

from processing.errors import ParameterError
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, Perspective

KINDS: dict[str, type[Geometry]] = {
    "equirectangular": Equirectangular,
    "perspective": Perspective,
    "fisheye": Fisheye,
}


def geometry_to_json(geometry: Geometry) -> dict[str, object]:
    """Return a geometry as JSON values: its kind and its fields; `geometry_from_json` gives an equal one back."""
    kind = next(name for name, cls in KINDS.items() if type(geometry) is cls)
    values = {field.name: getattr(geometry, field.name) for field in dataclasses.fields(geometry)}
    plain = {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}
    return {"kind": kind} | {
        key: str(value) if isinstance(value, LensMapping) else value for key, value in plain.items()
    }


def geometry_from_json(data: object) -> Geometry:
    """Return the geometry that `geometry_to_json` wrote.

    Raises `ParameterError` naming the field unless every field is there, of its type, finite, and sizes are positive.
    """
    if not isinstance(data, Mapping):
        raise ParameterError(f"a geometry is an object, not {type(data).__name__}")
    cls = KINDS.get(str(data.get("kind")))
    if cls is None:
        raise ParameterError(f"unknown kind of geometry {data.get('kind')!r}", advice=f"one of {', '.join(KINDS)}")
    hints = typing.get_type_hints(cls)
    if set(data) != {"kind", *hints}:
        raise ParameterError(f"{cls.__name__} has the fields {sorted(hints)}, not {sorted(set(data) - {'kind'})}")
    values: dict[str, Any] = {name: _value(name, data[name], hint) for name, hint in hints.items()}
    return cls(**values)


def _value(name: str, value: object, hint: object) -> object:
    """Return a field's value as its type; tuples of numbers were lists."""
    if hint is LensMapping:
        if value not in list(LensMapping):
            raise ParameterError(f"{name}: unknown lens mapping {value!r}", advice=f"one of {', '.join(LensMapping)}")
        return LensMapping(str(value))
    if hint is int:
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ParameterError(f"{name} is a positive whole number, not {value!r}")
        return value
    if hint is float:
        return _number(name, value)
    if value is None and isinstance(hint, types.UnionType):
        return None
    if not isinstance(value, list) or (isinstance(hint, types.UnionType) and len(value) != 2):
        raise ParameterError(f"{name} is a list of numbers, not {value!r}")
    return tuple(_number(name, one) for one in value)


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ParameterError(f"{name} is a finite number, not {value!r}")
    return float(value)
