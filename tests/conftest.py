"""For all tests: Hypothesis draws the same examples in every run, new ones where DAYLIT_TORTURE=1; one cache of worlds.

A run that fails by chance tells a user nothing about what he changed; the long runs look for new examples.
"""

from __future__ import annotations

import gc
import os
import shutil
import sys
import tempfile

import pytest
from hypothesis import settings

os.environ["DAYLIT_MODELS"] = os.devnull
"""No network of others, whatever is installed here."""
LONG = os.environ.get("DAYLIT_TORTURE") == "1"
"""Whether sweeps go over everything."""

os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
"""Byte code is kept: each of the many programs that tests start would else compile all that it imports."""

gc.set_threshold(100_000, 20, 100)
"""Chosen: at Python's own 700 a quarter of the collection and half of reading sources goes into looking for garbage."""

settings.register_profile("same", derandomize=True)
settings.register_profile("new", print_blob=True)
settings.load_profile("new" if LONG else "same")


def pytest_configure(config: pytest.Config) -> None:
    """Give all workers of this run one folder for rendered worlds: what one has made, none makes again."""
    if not hasattr(config, "workerinput"):
        folder = tempfile.mkdtemp(prefix="daylit-test-worlds-")
        os.environ["DAYLIT_CACHE"] = folder
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
