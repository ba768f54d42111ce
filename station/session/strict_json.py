"""JSON from a file that a stranger may have written: what Python's reader lets pass too easily is refused."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pydantic import ValidationError

# Chosen: a manifest is five levels deep; 19 digits hold 64 bits.
MAX_DEPTH = 50
MAX_DIGITS = 19  # of the largest 64-bit integer
_STRING = re.compile(rb'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)
_BRACKET = re.compile(rb"[\[\]{}]")


def faults_of(error: ValidationError) -> list[str]:
    """Return all that a model finds wrong with a file's values, each with its key first where one is to blame."""
    faults = error.errors(include_url=False, include_input=False, include_context=False)
    keys = (".".join(str(part)[:60] for part in one["loc"]) for one in faults)
    return [f"{key}: {one['msg']}" if key else one["msg"] for key, one in zip(keys, faults, strict=True)]


class StrictJsonError(ValueError):
    """Text that is not JSON as we accept it; the message says why."""


def _constant(text: str) -> Any:
    raise StrictJsonError(f"{text} is not a JSON number")


def _int(text: str) -> int:
    if len(text.lstrip("-")) > MAX_DIGITS:
        raise StrictJsonError(f"a number of {len(text)} digits")
    return int(text)


def _real(text: str) -> float:
    value = float(text) if len(text) <= 100 else math.inf
    if not math.isfinite(value):
        raise StrictJsonError(f"the number {text[:40]} is out of range or too long")
    return value


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise StrictJsonError(f"the key {twice[:80]!r} appears twice")
    return found


def loads(raw: bytes) -> Any:
    """Parse UTF-8 JSON, with or without a byte order mark.

    Raises `StrictJsonError` for anything but plain JSON of at most `MAX_DEPTH` levels: bad UTF-8, NaN and
    infinity, numbers beyond `MAX_DIGITS` digits or out of range, keys twice in one object, lone surrogates.
    """
    # Refuse deep nesting before the recursive reader meets it (strings are taken out first)
    depth = 0
    for bracket in _BRACKET.finditer(_STRING.sub(b"", raw)):
        depth += 1 if bracket[0] in b"[{" else -1
        if depth > MAX_DEPTH:
            raise StrictJsonError(f"nested deeper than {MAX_DEPTH} levels")
        if depth < 0:
            raise StrictJsonError("not JSON: a bracket closes that none opened")
    try:
        text = raw.decode("utf-8-sig")
        value = json.loads(text, parse_constant=_constant, parse_int=_int, parse_float=_real, object_pairs_hook=_object)
    except UnicodeDecodeError as exc:
        raise StrictJsonError(f"not UTF-8 at byte {exc.start}") from exc
    except json.JSONDecodeError as exc:
        raise StrictJsonError(f"not JSON: {exc.msg} at line {exc.lineno}, column {exc.colno}") from exc
    if re.search(r"\\u[dD][89a-fA-F]", text):
        try:
            json.dumps(value, ensure_ascii=False).encode("utf-8")
        except UnicodeEncodeError as exc:
            raise StrictJsonError("half a surrogate pair in a text") from exc
    return value
