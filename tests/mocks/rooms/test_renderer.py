"""What is reported of the renderer, and what happens where a part of it is missing."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from mocks.rooms import model as ade
from mocks.rooms.light import engine as engines
from mocks.rooms.light.engine import LLVM, SCALAR, Engine, EngineError
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.model import Material, Part, Role
from processing.ground.mesh import quad
from station.capture import preflight


def test_the_renderer_says_what_it_is_and_what_would_make_it_faster(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(engines.ASKED, raising=False)
    library = tmp_path / "libLLVM.so.19.1"
    assert f"llvm_ad_rgb (LLVM 19 at {library})" in str(Engine(LLVM, library))
    assert "scalar_rgb (install LLVM 16" in str(Engine(SCALAR, None))
    monkeypatch.setenv(engines.ASKED, SCALAR)
    assert str(Engine(SCALAR, None)).endswith(f"scalar_rgb (as {engines.ASKED} says)")


def test_doctor_warns_of_missing_libraries_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "LIBRARIES", ("numpy", "no_such_ray_caster"))
    check = preflight._check_renderer()
    assert (check.level, check.name) == ("warn", "renderer")
    assert check.text == "no_such_ray_caster not installed: rooms cannot be generated"
    assert check.advice


def test_without_embree_the_error_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "embreex.mesh_construction", None)
    square = quad((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    geometry = Geometry([Part(square, Material("white", (0.8, 0.8, 0.8)), "floor", ade.NO_CLASS, Role.SHELL)])
    up = np.array([[0.0, 0.0, 1.0]], np.float32)
    with pytest.raises(EngineError, match="rays cannot be cast") as caught:
        geometry.cast(-up[0], up)
    assert "--simulate room" in caught.value.advice
