"""The runner: one form, exit codes, and ``all`` that goes on."""

from __future__ import annotations

import json
import sys
from types import ModuleType
from typing import Any

import pytest
from click.testing import CliRunner

from benchmarks import __main__ as runner
from benchmarks import form as _form

KEYS = {"name", "metrics", "rivals", "units", "notes", "seconds", "machine", "versions", "seed", "quick"}


def offer(monkeypatch: pytest.MonkeyPatch, **found: Any) -> None:
    """Put benchmarks in the place of the real ones; an exception is raised, anything else is the answer."""
    for name, answer in found.items():
        module = ModuleType(f"benchmarks.{name}")

        def run(*, quick: bool, seed: int, answer: Any = answer) -> Any:
            if isinstance(answer, Exception):
                raise answer
            return answer

        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, f"benchmarks.{name}", module)
    monkeypatch.setattr(runner, "names", lambda: list(found))
    monkeypatch.setattr(_form, "modules", lambda: {name: f"benchmarks.{name}" for name in found})


def test_json_has_the_form(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = {"metrics": {"median_err_pct": 1.5, "peak_mb": 3, "rooms_ok": 5}, "rivals": {"x": {"peak_mb": 9.0}}}
    offer(monkeypatch, one=answer | {"units": {"rooms_ok": "of 6"}})
    done = CliRunner().invoke(runner.main, ["one", "--json", "--quick", "--seed", "4"])
    assert done.exit_code == 0
    result = json.loads(done.stdout.splitlines()[-1])
    assert set(result) == KEYS
    assert result["metrics"] == answer["metrics"]
    assert result["rivals"] == answer["rivals"]
    assert result["units"] == {"median_err_pct": "%", "peak_mb": "MB", "rooms_ok": "of 6"}
    assert (result["name"], result["seed"], result["quick"]) == ("one", 4, True)
    assert {"cpu", "cores", "system", "python"} <= set(result["machine"])
    assert {"numpy", "mitsuba", "pvlib", "embreex", "pyoidn", "scipy", "shapely"} <= set(result["versions"])


def test_text_shows_each_figure_with_its_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, one={"metrics": {"err_pct": 1.5}, "rivals": {"robertson": {"cpu_s": 2.0}}, "notes": ["why"]})
    lines = CliRunner().invoke(runner.main, ["one"]).stdout.splitlines()
    assert lines[1].split() == ["metric", "err_pct", "1.5", "%"]
    assert lines[2].split() == ["rival", "robertson.cpu_s", "2.0"]
    assert lines[3].split() == ["note", "why"]


def test_failure_says_which_and_why(monkeypatch: pytest.MonkeyPatch) -> None:
    offer(monkeypatch, one=FileNotFoundError("the pictures are not here"))
    done = CliRunner().invoke(runner.main, ["one", "--json"])
    assert done.exit_code == 1
    assert done.stdout == ""
    assert "one could not run: FileNotFoundError: the pictures are not here" in done.stderr


def test_all_goes_on_after_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    good = {"metrics": {"n": 1}}
    offer(monkeypatch, first=good, second=RuntimeError("no"), third=good, fourth=RuntimeError("no"))
    done = CliRunner().invoke(runner.main, ["all", "--json"])
    assert done.exit_code == 1
    assert [json.loads(line)["name"] for line in done.stdout.splitlines()] == ["first", "third"]
    assert done.stderr.splitlines()[-1] == "could not run: second, fourth"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "fast", True, None])
def test_figure_that_is_no_number_is_a_failure(monkeypatch: pytest.MonkeyPatch, value: object) -> None:
    offer(monkeypatch, one={"metrics": {"n": value}})
    done = CliRunner().invoke(runner.main, ["one", "--json"])
    assert done.exit_code == 1
    assert "n is not a finite number" in done.stderr


def test_unknown_name_lists_the_known() -> None:
    done = CliRunner().invoke(runner.main, ["no-such"])
    assert done.exit_code == 2
    assert "truth" in done.stderr


def test_names_are_the_public_modules_that_run() -> None:
    found = _form.names()
    assert {"capture", "truth"} <= set(found)
    assert "seeds" not in found
    assert not [name for name in found if name.startswith("_")]
