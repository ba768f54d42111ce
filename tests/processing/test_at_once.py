"""What would leave a core idle is done side by side, and gives the same by one thread as by two."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from processing.calibration.scale import photometry
from processing.calibration.scale.photometry import PLANES, illuminances_lx
from processing.errors import PictureFileError
from processing.light.scene import furnished
from processing.light.scene.furnished import OldFurniture, furnished_light
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import FIRST_PART, sight_of
from processing.light.solver.stage import Stage
from processing.pictures import exr
from processing.pictures.exr import read_exr, write_exr
from processing.report import states
from processing.report.room_states import Made
from processing.report.states import Look, State, cuts_of
from processing.sphere import Equirectangular, Fisheye, LensMapping, resampling_area
from processing.sphere.resampling import resample
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky
from tests.processing.pictures.picture_strategies import luminance_image

GEOMETRY = Equirectangular(64, 32)
WAIT_S = 10.0  # for the other thread to begin
NOISE = np.random.default_rng(7).random((32, 64, 3)).astype(np.float32) + np.float32(0.1)


def planes(_folder: Path) -> object:
    return illuminances_lx(luminance_image(NOISE, GEOMETRY), list(PLANES.values()))


def hemisphere(_folder: Path) -> object:
    whole = resample(NOISE, Fisheye(64, 32, LensMapping.EQUIDISTANT, 16), GEOMETRY)
    return [part.tobytes() for part in whole]


def read(folder: Path) -> object:
    if not (folder / "a.exr").exists():  # writing looks at it, too
        write_exr(folder / "a.exr", luminance_image(NOISE, GEOMETRY))
    found = read_exr(folder / "a.exr")
    return found.rgb.tobytes(), found.uncertainty.tobytes(), found.validity.tobytes()


def cuts(_folder: Path) -> object:
    return cuts_of(State("Photograph", lambda: luminance_image(NOISE, GEOMETRY), Made()), Look(), 64)


def lights(_folder: Path) -> object:
    room, sky, cabinet = box_room(), uniform_sky(4000.0), box((1.7, 0.7, 0.55), (1.2, 2.2, 1.1))
    stage = Stage.of(scene_of(room, sky).furnished((cabinet,)), 0.5)
    seen = sight_of(stage, GEOMETRY, EYE).label.reshape(32, 64) >= FIRST_PART
    work = Effort(texel_m=0.5, patch_samples=8, rows=32, pixel_samples=8, sun_samples=8, clean=False)
    old = OldFurniture(seen, seen, (cabinet,))
    return furnished_light(luminance_image(NOISE, GEOMETRY), room, sky, old, rows=32, effort=work).log_change.tobytes()


CASES = [
    (planes, [(photometry, "_add_light")]),
    (hemisphere, [(resampling_area, "gather")]),
    (read, [(exr, "_digest"), (exr, "check_image")]),
    (cuts, [(states, "viewer"), (states, "cut_view")]),
    (lights, [(furnished, "light_map")]),
    (lights, [(furnished, "gathered")]),
]


@pytest.mark.parametrize(("made", "inner"), CASES, ids=[inner[0][1] for _, inner in CASES])
def test_two_threads_work_at_once_and_the_result_is_that_of_one(
    made: Callable[[Path], object],
    inner: list[tuple[Any, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DAYLIT_THREADS", "1")
    alone = made(tmp_path)
    monkeypatch.setenv("DAYLIT_THREADS", "2")
    running, both = list[int](), threading.Event()

    def watched(work: Callable[..., Any]) -> Callable[..., Any]:
        def waiting(*args: Any, **options: Any) -> Any:
            running.append(threading.get_ident())
            if len(set(running)) == 2:
                both.set()
            both.wait(WAIT_S)
            try:
                return work(*args, **options)
            finally:
                running.remove(threading.get_ident())

        return waiting

    for module, name in inner:
        monkeypatch.setattr(module, name, watched(getattr(module, name)))
    assert made(tmp_path) == alone
    assert both.is_set()


def test_changed_light_is_said_before_what_is_wrong_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both are looked at side by side."""
    monkeypatch.setenv("DAYLIT_THREADS", "2")
    dark = luminance_image(NOISE, GEOMETRY)
    monkeypatch.setattr(exr, "check_image", lambda *_: None)
    dark.rgb[3, 4] = -1.0
    write_exr(tmp_path / "a.exr", dark)
    monkeypatch.undo()
    with pytest.raises(PictureFileError, match="impossible light"):
        read_exr(tmp_path / "a.exr")
    monkeypatch.setattr(exr, "_digest", lambda *_: 0)
    with pytest.raises(PictureFileError, match="has changed since it was written"):
        read_exr(tmp_path / "a.exr")
