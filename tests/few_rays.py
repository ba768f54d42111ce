"""Few rays and coarse texels, for tests that look for what is lit, not how well; the long runs have them all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from processing.light.solver.basis import BASIS_EFFORTS
from processing.light.solver.irradiance import EFFORTS
from processing.stages import light, render
from tests.conftest import LONG


@pytest.fixture(scope="module")
def few_rays() -> Iterator[None]:
    """Light of any quality, by few rays."""
    few = {"texel_m": 0.3, "rows": 48, "patch_samples": 16, "pixel_samples": 8, "sun_samples": 8}
    with pytest.MonkeyPatch.context() as patch:
        for table in () if LONG else (BASIS_EFFORTS, EFFORTS, render.QUALITY):
            for quality, effort in table.items():
                patch.setitem(table, quality, replace(effort, **few))
        for quality, (rows, effort) in () if LONG else light.WORK.items():
            patch.setitem(light.WORK, quality, (rows, replace(effort, **few)))
        yield
