"""For all tests: Hypothesis draws the same examples in every run, new ones where DAYLIT_TORTURE=1; models: none.

A run that fails by chance tells a user nothing about what he changed; the long runs look for new examples.
"""

from __future__ import annotations

import os

from hypothesis import settings

os.environ["DAYLIT_MODELS"] = os.devnull

settings.register_profile("same", derandomize=True)
settings.register_profile("new", print_blob=True)
settings.load_profile("new" if os.environ.get("DAYLIT_TORTURE") == "1" else "same")
