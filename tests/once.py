"""Pure functions of the pipeline, worked out once a worker for the same arguments where tests are about something else.

A test of a stage changes one thing and looks at what follows from it; what the stage does with pictures that are the
same as in the test before, a response curve first of all, would be most of its time. What is given back is a copy of
its own. Tests of these functions call them by the modules that they are from, where nothing is exchanged; one that is
about a second run being the same, or about time, asks for `anew`.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.errors import DaylitError
from tests.conftest import LONG

PURE = {
    "processing.stages.merge": ("recover_response", "check_response", "fit_linear", "place_lenses"),
    "processing.calibration.optics": ("kernel_from_surround", "without_glare"),
    "processing.calibration.outdoor.outdoor": ("project",),
    "processing.sphere.area": ("fisheye_projected",),
    "processing.stages.detect": ("find_masks",),
    "processing.figures.foreign": ("recover_response", "merge"),
    "processing.rig.camera_fit": ("recover_response", "find_chart_around", "merged_bracket"),
    "processing.rig.calibrate": ("find_chart_around",),
    "processing.layout.models.catalogue": ("build_model",),
    "processing.report.stills": ("frames_of",),
    "processing.report.calibration_sections": ("illuminance_rose",),
    "processing.report.sections": ("plan_plot",),
}
"""What most of the time of stages, rigs and reports goes into, by the modules that call it."""
FEW = {
    "processing.calibration.response.samples": {"CANDIDATES": 1600, "MAX_SAMPLES": 450},
    "processing.calibration.response.bracket_fit": {"_QUICK_PATCHES": 300},
    "processing.calibration.response.linear": {"GRID_SAMPLES": 15_000},
    "processing.calibration.merge.tables": {"GRID_SAMPLES": 4_000},
}
"""Responses are fitted, and frames compared, by fewer pixels here. Tests of both have as many as users do."""
_kept: dict[tuple[str, bytes], bytes] = {}
_anew: list[bool] = []


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the function with what it has returned before for equal arguments, or raised of our errors."""
    name = f"{function.__module__}:{function.__qualname__}"

    @functools.wraps(function)
    def kept(*given: Any, **named: Any) -> Any:
        if _anew:
            return function(*given, **named)
        try:
            asked = pickle.dumps((given, sorted(named.items())), protocol=5)
        except (AttributeError, TypeError, pickle.PicklingError):  # a function of the caller's own
            return function(*given, **named)
        key = name, hashlib.sha256(asked).digest()
        if key not in _kept:
            try:
                _kept[key] = pickle.dumps((function(*given, **named), None), protocol=5)
            except DaylitError as error:
                _kept[key] = pickle.dumps((None, error), protocol=5)
                raise
        answer, refused = pickle.loads(_kept[key])
        if refused is not None:
            raise refused
        return answer

    return kept


@contextmanager
def each_once(names: Mapping[str, Sequence[str]]) -> Iterator[None]:
    """Exchange functions in the modules that call them, by module."""
    with pytest.MonkeyPatch.context() as patched:
        for module, functions in names.items():
            for name in functions:
                there = importlib.import_module(module)
                patched.setattr(there, name, once(getattr(there, name)))
        yield


@contextmanager
def fewer_patches() -> Iterator[None]:
    """Fit responses to `FEW` patches."""
    with pytest.MonkeyPatch.context() as patched:
        for module, numbers in FEW.items():
            for name, number in numbers.items():
                patched.setattr(importlib.import_module(module), name, number)
        yield


@contextmanager
def all_anew() -> Iterator[None]:
    """Work all out while this lasts."""
    _anew.append(True)
    try:
        yield
    finally:
        _anew.pop()


@pytest.fixture(scope="module", autouse=True)
def each_pure_once() -> Iterator[None]:
    """For the tests of a folder whose conftest takes it in: `PURE`, once each, from `FEW` pixels.

    Not of the scope "package", which ends with the session where a folder has no ``__init__.py``.
    """
    with each_once(PURE), fewer_patches():
        yield


@pytest.fixture
def few_patches() -> Iterator[None]:
    """For a test of responses that is about something else than how exact they are; the long runs have them whole."""
    if LONG:
        yield
        return
    with fewer_patches():
        yield


@pytest.fixture
def anew() -> Iterator[None]:
    """For a test that must not be given what was worked out before."""
    with all_anew():
        yield
