"""Rigs in tests: a camera is fitted once for each choice of its frames, as most tests calibrate the same ones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from processing.rig import calibrate
from processing.rig.camera_fit import CameraFit, SessionSide, fit_camera

_FITTED: dict[tuple[Any, ...], CameraFit] = {}


def _frames(taken: SessionSide) -> tuple[Any, ...]:
    """All that a fit takes from a session."""
    return taken.session_id, taken.side, taken.nominal_s, taken.state.model_dump_json(), tuple(one.sha256 for one in taken.records)


@contextmanager
def fitted_once() -> Iterator[None]:
    """Have `calibrate_rig` use a camera's fit again, where it is asked for the same of the same frames."""

    def once(takes: Sequence[SessionSide], circle_of: SessionSide, *rest: Any) -> CameraFit:
        asked = (*map(_frames, takes), "circle", _frames(circle_of), circle_of.circle_frac, *rest)
        if asked not in _FITTED:
            _FITTED[asked] = fit_camera(takes, circle_of, *rest)
        return _FITTED[asked]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(calibrate, "fit_camera", once)
        yield
