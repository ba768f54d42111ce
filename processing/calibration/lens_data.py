"""Published calibrations that come with the program: `lens_data.toml`, with their sources."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def lens_data() -> dict[str, Any]:
    """Return the tables ``vignetting`` and ``nd_filter``, by name."""
    return tomllib.loads(files("processing.calibration").joinpath("lens_data.toml").read_text("utf-8"))
