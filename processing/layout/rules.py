"""Rule sets and weights from a TOML file: ours (`rules.toml`) or a user's edited copy."""

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from processing.errors import RulesError
from processing.ground.tables import table_of

LIMITS_M = {"path": (0.3, 3.0), "door_approach": (0.3, 3.0), "door_reach": (0.5, 2.0), "together": (0.1, 20.0)}
COUNTS = {"bed_sides": (0, 2), "bed_single_sides": (0, 2)}
MAX_LENGTH_M = 3.0  # chosen: no rule asks for as much free space


@dataclass(frozen=True)
class RuleSet:
    """The numbers of one rule set in metres (`rules.toml` says where each comes from)."""

    name: str
    path: float
    door_approach: float
    door_side: float
    door_reach: float
    window_band: float
    bed_side: float
    bed_foot: float
    bed_sides: int
    bed_single_sides: int
    wardrobe_front: float
    chest_front: float
    shelf_front: float
    desk_back: float
    seat_front: float
    table_gap: float
    tv_front: float
    dining_edge: float
    turning_circle: float
    together: float


KEYS = tuple(field.name for field in fields(RuleSet) if field.name != "name")


@dataclass(frozen=True)
class Rules:
    """All rule sets of a file, and the weights of the soft scores."""

    sets: Mapping[str, RuleSet]
    weights: Mapping[str, float]

    def named(self, name: str) -> RuleSet:
        """Return one rule set; raise `RulesError` naming those there are."""
        if name not in self.sets:
            raise RulesError(f"no rule set '{name}'; there are: {', '.join(self.sets)}")
        return self.sets[name]


@cache
def built_in_rules() -> Rules:
    """Return the rules that come with daylit."""
    return _rules(table_of(__package__, "rules"), "rules.toml", None)


def read_rules(path: Path) -> Rules:
    """Read a user's rules.

    Keys that a set leaves out are the built-in `standard` set's (or, of a set named as a built-in one, that one's).
    Raises `RulesError` naming file and key.
    """
    try:
        data = tomllib.loads(path.read_text("utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise RulesError(f"cannot be read: {error}", where=path.name) from None
    return _rules(data, path.name, built_in_rules())


def _rules(data: Mapping[str, Any], where: str, base: Rules | None) -> Rules:
    if data.get("version") != 1:
        raise RulesError("its 'version' is not 1", where=where)
    unknown = set(data) - {"version", "sets", "weights"}
    if unknown:
        raise RulesError(f"unknown tables: {', '.join(sorted(unknown))}", where=where)
    sets = dict(base.sets) if base else {}
    for name, values in _table(data.get("sets", {}), "sets", where).items():
        at = f"{where}, sets.{name}"
        start = (base.sets.get(name) or base.sets["standard"]) if base else None
        sets[name] = _rule_set(name, _table(values, name, where), at, start)
    weights = dict(base.weights) if base else {}
    for key, value in _table(data.get("weights", {}), "weights", where).items():
        if base and key not in base.weights:
            raise RulesError(f"unknown weight '{key}'; there are: {', '.join(base.weights)}", where=where)
        weights[key] = _number(value, key, f"{where}, weights", 0.0, 1000.0)
    return Rules(MappingProxyType(sets), MappingProxyType(weights))


def _rule_set(name: str, values: Mapping[str, Any], where: str, start: RuleSet | None) -> RuleSet:
    unknown = set(values) - set(KEYS)
    if unknown:
        raise RulesError(f"unknown keys: {', '.join(sorted(unknown))}", where=where)
    values_by_key: dict[str, Any] = asdict(start) if start else {}
    for key, value in values.items():
        low, high = COUNTS.get(key) or LIMITS_M.get(key, (0.0, MAX_LENGTH_M))
        number = _number(value, key, where, low, high)
        values_by_key[key] = int(number) if key in COUNTS else number
    missing = set(KEYS) - set(values_by_key)
    if missing:
        raise RulesError(f"missing keys: {', '.join(sorted(missing))}", where=where)
    return RuleSet(**{**values_by_key, "name": name})


def _table(value: Any, key: str, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise RulesError(f"'{key}' is not a table", where=where)
    return value


def _number(value: Any, key: str, where: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise RulesError(f"'{key}' = {value!r} is not between {low:g} and {high:g}", where=where)
    return float(value)
