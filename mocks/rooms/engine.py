"""Mitsuba, loaded when first needed, in the fastest variant that is safe on this computer.

``llvm_ad_rgb`` where an LLVM library is found that is proven to work (`mocks.rooms.llvm`), else ``scalar_rgb``, which
works everywhere; ``DAYLIT_MITSUBA_VARIANT`` chooses either. The two give the same pictures but for their noise. Both
use as many threads as this process may use cores.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from drivers.errors import DaylitError
from mocks.rooms.llvm import usable_library

SCALAR, LLVM = "scalar_rgb", "llvm_ad_rgb"


class EngineError(DaylitError):
    """The renderer asked for cannot be had."""

    code = "SIM-003"
    exit_code = 2


@dataclass(frozen=True)
class Engine:
    """The renderer in use."""

    variant: str
    """``llvm_ad_rgb`` or ``scalar_rgb``."""
    llvm: Path | None
    """The LLVM library of the former."""


@cache
def engine() -> Engine:
    """Return the renderer for this process, chosen once."""
    asked = os.environ.get("DAYLIT_MITSUBA_VARIANT")
    if asked not in (None, "", SCALAR, LLVM):
        raise EngineError(
            f"no renderer is called {asked!r}",
            where="DAYLIT_MITSUBA_VARIANT",
            likely="a misspelt name",
            advice=f"say {SCALAR} or {LLVM}, or leave it unset",
        )
    library = None if asked == SCALAR else usable_library()
    if asked == LLVM and library is None:
        raise EngineError(
            "no LLVM library works here",
            where="DAYLIT_MITSUBA_VARIANT",
            likely="LLVM 16 or newer is not installed, or not where it is looked for",
            advice=f"install libllvm19, or name the library in DRJIT_LIBLLVM_PATH, or say {SCALAR}",
        )
    return Engine(LLVM, library) if library else Engine(SCALAR, None)


def variant() -> str:
    """Return the name of Mitsuba's variant in use."""
    return engine().variant


@cache
def mitsuba() -> Any:
    """Return the module ``mitsuba`` with the variant set."""
    chosen = engine()
    if chosen.llvm:
        # Dr.Jit looks here when it is first used.
        os.environ["DRJIT_LIBLLVM_PATH"] = str(chosen.llvm)
    import mitsuba as mi

    mi.set_variant(chosen.variant)
    return mi
