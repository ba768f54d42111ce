"""Mitsuba's variants, and systems on which it cannot be loaded."""

from __future__ import annotations

import importlib

import pytest

from processing.errors import EngineError
from processing.ground import mitsuba_variants


def drjit_without_libatomic(_name: str) -> None:
    try:
        raise ImportError("libatomic.so.1: cannot open shared object file")
    except ImportError:
        raise NameError("name '_drjit_ext' is not defined")  # noqa: B904 (as Dr.Jit's own __init__ does it)


def test_a_missing_system_library_is_named_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib, "import_module", drjit_without_libatomic)
    with pytest.raises(EngineError, match="libatomic") as caught:
        mitsuba_variants.load_mitsuba(mitsuba_variants.SCALAR)
    assert "apt install libatomic1" in caught.value.advice
