"""What is seen through windows in another light: what shades the sun there, and what stands before the sky."""

from __future__ import annotations

import numpy as np
import pytest

from processing.light.picture.relight_photo import bare_sky, land_of, level_lx, with_captured_land
from processing.light.scene.scene import Outdoors, Pane
from processing.light.solver.sun import clear_of_sun
from tests.processing.light.rooms import uniform_sky
from tests.processing.light.test_relight import sun_at

EYE_M = 1.6
ROWS, COLUMNS = 30, 40


def pane_with(*covered: tuple[slice, slice]) -> Pane:
    """A pane 1.6 m wide, from 0.9 to 2.1 m; cells of 4 cm."""
    clear = np.ones((ROWS, COLUMNS), np.float32)
    for rows, columns in covered:
        clear[rows, columns] = 0
    return Pane(
        corner_m=np.array([-0.8, 2.0, 0.9]),
        across_m=np.array([1.6, 0.0, 0.0]),
        up_m=np.array([0.0, 0.0, 1.2]),
        clear=clear,
        veil_cd_m2=np.full((ROWS, COLUMNS, 3), 30, np.float32),
    )


ALL = slice(None)
BARS = {
    "frame, known above the horizon only": ((slice(0, 12), slice(0, 2)), (ALL, slice(0, 2))),
    "bar across": ((slice(5, 7), ALL), (slice(5, 7), ALL)),
    "post": ((ALL, slice(20, 22)), (ALL, slice(20, 22))),
    "blind, half drawn": ((slice(0, 14), ALL), (slice(0, 14), ALL)),
    "curtain": ((ALL, slice(28, 40)), (ALL, slice(28, 40))),
}


@pytest.mark.parametrize(("result", "wanted"), BARS.values(), ids=list(BARS))
def test_what_runs_along_the_glass_shades_the_sun(result, wanted) -> None:
    found = clear_of_sun(pane_with(result), EYE_M)
    assert (found == pane_with(wanted).clear).all()


def test_trees_and_shadows_on_the_ground_do_not() -> None:
    tree, hedge, speck = (slice(6, 22), slice(12, 22)), (slice(16, 24), ALL), (slice(20, 21), slice(3, 30))
    assert clear_of_sun(pane_with(tree, speck), EYE_M).all()
    assert clear_of_sun(pane_with(hedge), EYE_M).all()
    assert (clear_of_sun(pane_with(tree, BARS["post"][0]), EYE_M) == pane_with(BARS["post"][0]).clear).all()


def test_drawn_and_unknown_coverings_stay() -> None:
    shut = pane_with((ALL, ALL))
    assert not clear_of_sun(shut, EYE_M).any()
    one = Pane(shut.corner_m, shut.across_m, shut.up_m, clear=np.full((1, 1), 0.3, np.float32))
    assert clear_of_sun(one, EYE_M) is one.clear
    # Seen from above, no cell lies before the sky: columns are found by all rows.
    assert (clear_of_sun(pane_with(BARS["curtain"][0]), 5.0) == pane_with(BARS["curtain"][1]).clear).all()


def landscape(rows: int = 64, level: float = 2000.0) -> tuple[Outdoors, np.ndarray]:
    """A sky with a tree, a pale house and a cloud, over green ground."""
    sky = np.full((rows, 2 * rows, 3), level, np.float32)
    sky[rows // 2 :] = (60, 120, 40)
    land = np.zeros((rows, 2 * rows), bool)
    land[rows // 2 :] = True
    land[25:32, 20:28] = True
    sky[25:32, 20:28] = (40, 80, 20)
    land[28:32, 60:70] = True
    sky[28:32, 60:70] = (900, 800, 500)
    sky[23:25, 90:100] = 1.6 * level
    return Outdoors(sky), land


def test_land_is_distinguished_from_the_sky() -> None:
    outdoors, land = landscape()
    assert (land_of(outdoors) == land).all()
    bare = bare_sky(outdoors.rgb, land)
    assert bare[33:, 20:28] == pytest.approx(2000.0, rel=1e-3)
    assert not land_of(uniform_sky(1000.0))[: 32 // 2].any()


def test_what_outshines_any_house_is_sky() -> None:
    outdoors, _ = landscape()
    rgb = outdoors.rgb.copy()
    rgb[24:32, 100:110] = 1e5
    assert not land_of(Outdoors(rgb))[:32, 100:110].any()


def test_land_stays_under_another_sky() -> None:
    captured, land = landscape()
    other = uniform_sky(8000.0, sun_at(0, -1, 1))
    found = with_captured_land(other, captured)
    ratio = level_lx(other) / level_lx(captured)
    assert found.rgb.shape == captured.rgb.shape
    assert found.sun == other.sun
    assert found.rgb[land] == pytest.approx(captured.rgb[land] * ratio, rel=1e-4)
    assert found.rgb[:20] == pytest.approx(8000.0)


def test_land_of_a_place_that_nobody_saw() -> None:
    dark = Outdoors(np.zeros((16, 32, 3), np.float32))
    found = with_captured_land(uniform_sky(1000.0), dark)
    assert np.isfinite(found.rgb).all()
    assert found.rgb[-1] == pytest.approx(0.2 / np.pi * level_lx(uniform_sky(1000.0)), rel=1e-4)
