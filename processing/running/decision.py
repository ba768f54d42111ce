"""Whether a stage has to run, and why: compares what its result was made of with what there is now."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from processing.running.fingerprint import Ingredients, changes, digest
from processing.running.result_store import Stored
from processing.running.results import Change, StageResult

MAX_SHOWN = 60


@dataclass(frozen=True)
class Decision:
    """``result`` is the one to keep; None: the stage has to run."""

    result: StageResult | None
    reason: str
    changes: tuple[Change, ...] = ()


def decide(stored: Stored, ingredients: Ingredients, *, forced: bool) -> Decision:
    """Return whether what is on disk still stands."""
    if stored.problem:
        return Decision(None, f"its result cannot be used: {stored.problem}")
    result = stored.result
    if result is None:
        return Decision(None, "there is no result yet")
    if forced:
        return Decision(None, "asked for by --force")
    if result.fingerprint == digest(ingredients):
        return Decision(result, _why_kept(result))
    found = tuple(changes(result.ingredients, ingredients))
    if not found:
        return Decision(None, "changed: it was made by another version of the program")
    more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
    return Decision(None, f"changed: {change_line(found[0])}{more}", found)


def _why_kept(result: StageResult) -> str:
    if result.skipped:
        return f"nothing to do: {result.skipped}"
    kept = f"{len(result.files)} file{'' if len(result.files) == 1 else 's'} intact"
    given = f"given by you ({', '.join(result.given)}); " if result.given else ""
    return f"{given}nothing it depends on has changed, {kept}"


def change_line(change: Change) -> str:
    """Return a change in words: ``parameters k1: 0.5 -> 0.6``."""
    path, old, new = change
    return f"{path}: {shown(old)} -> {shown(new)}"


def shown(value: Any) -> str:
    """Return a JSON value in at most `MAX_SHOWN` characters; digests are cut to 12."""
    if value is None:
        return "none"
    text = str(value)
    if len(text) == 64 and all(c in "0123456789abcdef" for c in text):
        return text[:12]
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."
