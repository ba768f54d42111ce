"""Every error has a code of its own, and the troubleshooting page knows it."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

from drivers.errors import DaylitError

ROOT = Path(__file__).resolve().parents[2]
EXIT_CODES = {2, 3, 4, 5, 6, 70}


def all_errors(base: type[DaylitError] = DaylitError) -> set[type[DaylitError]]:
    """Return the error classes of all modules that define some."""
    for module in (
        "station.errors",
        "station.capture.preflight",
        "drivers.meter.dialect",
        "mocks.worlds.light",
        "mocks.optics.picture_cache",
        "mocks.rooms.light.engine",
        "mocks.rooms.truth",
        "processing.errors",
        "studio.sessions",
    ):
        importlib.import_module(module)
    found = {base}
    for child in base.__subclasses__():
        found |= all_errors(child)
    return {e for e in found if not e.__module__.startswith("tests")}


def table() -> dict[str, int]:
    text = (ROOT / "docs" / "reference" / "errors.md").read_text("utf-8")
    return {code: int(exit_code) for code, exit_code in re.findall(r"^\| ([A-Z]{3}-\d{3}) \| (\d+) \|", text, re.M)}


def test_codes_are_unique() -> None:
    codes = [e.code for e in all_errors()]
    assert len(codes) == len(set(codes)), sorted(c for c in codes if codes.count(c) > 1)


def test_page_has_every_code_with_its_exit_code() -> None:
    assert table() == {e.code: e.exit_code for e in all_errors()}


def test_exit_codes_are_the_documented_ones() -> None:
    assert {e.exit_code for e in all_errors()} <= EXIT_CODES


def test_errors_say_what_where_why_and_what_to_do() -> None:
    error = DaylitError("it broke", where="here", likely="a stone", advice="remove it", depth_m=2)
    assert str(error) == "here: it broke | likely cause: a stone | what to do: remove it"
    assert error.to_dict()["details"] == {"depth_m": 2}
