"""Every module of the benchmarks can be imported: what they read of the product is still there."""

from __future__ import annotations

import importlib
import pkgutil

import pytest

import benchmarks

MODULES = sorted(one.name for one in pkgutil.walk_packages(benchmarks.__path__, "benchmarks."))
OTHERS = {"bpy"}
"""Programs of others that are not installed with the rest."""


@pytest.mark.parametrize("name", [one for one in MODULES if not one.endswith("__main__")])
def test_it_finds_what_it_reads(name: str) -> None:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in OTHERS:
            raise
        pytest.skip(f"{error.name} is not installed")
