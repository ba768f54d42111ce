"""The room from other places: what the camera saw, what it did not, and places that cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from processing.errors import ViewpointError
from processing.light.picture.render import render
from processing.light.picture.viewpoint import check_place, seen_from
from processing.light.scene.scene import plain
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import (
    CELLS,
    FIRST_PART,
    GLASS,
    PERIOD_M,
    crease,
    crease_slopes,
    own_pixels,
    seen_outdoors,
    sight_of,
)
from processing.light.solver.stage import Stage
from processing.sphere import Equirectangular, Perspective
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky

ROWS = 48
LOOK = Effort(texel_m=0.25, patch_samples=48, rows=48, pixel_samples=32, sun_samples=16, clean=False)
TABLE = box((1.2, 0.8, 0.4), (0.8, 0.8, 0.8), name="table: oak")


def colours(name: str) -> np.ndarray:
    return plain({"floor": 0.2, "ceiling": 0.8}.get(name, 0.5))


@pytest.fixture(scope="module")
def room():
    return scene_of(box_room(), uniform_sky(4000.0), colours, reveal_m=0.2).furnished((TABLE,))


@pytest.fixture(scope="module")
def photograph(room) -> np.ndarray:
    return render(room, Equirectangular(2 * ROWS, ROWS), EYE, effort=LOOK, seed=1).rgb


def test_from_elsewhere_it_is_what_a_render_from_there_shows(room, photograph) -> None:
    eye = (2.2, 1.6, 0.5)
    geometry = Equirectangular(96, 48)
    found = seen_from(room, photograph, EYE, geometry, eye, effort=LOOK, seed=2)
    truth = render(room, geometry, eye, effort=LOOK, seed=3).rgb
    ratio = found.rgb.sum(axis=2) / truth.sum(axis=2)
    assert np.median(np.abs(ratio[found.seen] - 1)) < 0.1
    hidden = ~found.seen & ~found.glass
    assert 0.05 < hidden.mean() < 0.5
    assert np.median(np.abs(ratio[hidden] - 1)) < 0.15
    assert found.seen.mean() > 0.4


def test_from_the_camera_itself_it_is_the_photograph(room, photograph) -> None:
    found = seen_from(room, photograph, EYE, Equirectangular(2 * ROWS, ROWS), EYE, effort=LOOK)
    assert found.rgb[found.seen] == pytest.approx(photograph[found.seen], rel=1e-3)
    assert found.seen[~found.glass].mean() > 0.9


def test_what_hangs_only_in_the_photograph_is_seen_from_elsewhere(room, photograph) -> None:
    painted = photograph.copy()
    wall = np.zeros((ROWS, 2 * ROWS), bool)
    wall[21:26, 45:51] = True  # ahead: the wall at y = 2
    painted[wall] = (900.0, 0.0, 0.0)
    view = Perspective(60, 40, 1.4)
    found = seen_from(room, painted, EYE, view, (-0.5, 0.5, 1.5), effort=LOOK)
    red = (found.rgb[..., 0] > 500) & (found.rgb[..., 1] < 50)
    assert red.sum() > 15
    # It hangs at x = 0: to the right of an eye at x = -0.5.
    assert np.argwhere(red)[:, 1].mean() > 32


def test_a_black_photograph_stays_black_and_finite(room) -> None:
    found = seen_from(
        room, np.zeros((16, 32, 3), np.float32), EYE, Perspective(16, 12, 1.2), (0.5, 0.5, 1.2), effort=LOOK
    )
    assert np.isfinite(found.rgb).all()
    assert not found.rgb[found.seen].any()


@pytest.mark.parametrize(
    ("eye", "why"),
    [
        ((3.0, 0.0, 1.6), "outside the room"),
        ((0.0, 0.0, 2.8), "above the ceiling"),
        ((0.0, 0.0, -0.1), "below the floor"),
        ((1.2, 0.8, 0.4), "within table"),
        ((float("nan"), 0.0, 1.0), "not a number"),
    ],
)
def test_places_that_cannot_be(room, eye, why) -> None:
    with pytest.raises(ViewpointError, match=why):
        check_place(room, eye)


def test_places_that_can(room) -> None:
    for eye in ((1.2, 0.8, 0.85), (2.49, 1.99, 0.01), EYE):
        check_place(room, eye)
    inside_out = replace(TABLE, faces=TABLE.faces[:, ::-1])
    with pytest.raises(ViewpointError, match="within table"):
        check_place(scene_of(box_room(), uniform_sky()).furnished((inside_out,)), (1.2, 0.8, 0.4))


def test_pixels_of_another_surface_do_not_bleed() -> None:
    picture = np.zeros((4, 8, 3), np.float32)
    labels = np.zeros((4, 8), np.int32)
    picture[:, 4:], labels[:, 4:] = 100.0, 1
    ahead = np.array([[0.0, 1.0, 0.0]], np.float32)
    for label, value in ((0, 0.0), (1, 100.0)):
        found, weight = own_pixels(picture, labels, ahead, np.array([label], np.int32))
        assert found[0, 0] == pytest.approx(value)
        assert weight[0] > 0
    _, none = own_pixels(picture, labels, ahead, np.array([7], np.int32))
    assert none[0] == 0


def test_creases_lean_the_normals_of_cloth_and_of_nothing_else() -> None:
    """A level top: normals lean by two thirds of the slopes' square, to all sides; those beside stay as they are."""
    geometry, normals = Perspective(160, 120, 1.2, pitch_rad=-1.2), []
    for creases in (0.0, 0.2):
        parts = (box((0, 0.6, 0.4), (1.6, 1.2, 0.8), creases=creases), box((-1.5, 0.6, 0.4), (1.0, 1.2, 0.8)))
        sight = sight_of(Stage.of(scene_of(box_room(), uniform_sky()).furnished(parts)), geometry, EYE)
        top = (sight.label == FIRST_PART) & (np.abs(sight.point[:, 2] - 0.8) < 1e-3)
        normals.append(sight.normal)
    smooth, creased = normals
    assert top.sum() > 5000
    assert np.array_equal(smooth[top], np.broadcast_to(np.float32([0, 0, 1]), smooth[top].shape))
    assert np.array_equal(smooth[sight.label != FIRST_PART], creased[sight.label != FIRST_PART])
    assert np.allclose(np.linalg.norm(creased[top], axis=1), 1, atol=1e-5)
    slope = creased[top, :2] / creased[top, 2:]
    assert np.sqrt((slope**2).sum(axis=1).mean()) == pytest.approx(0.2 * np.sqrt(2 / 3), rel=0.25)
    assert np.abs(slope.mean(axis=0)).max() < 0.05  # cloth is not tilted as a whole


def test_creases_are_the_slopes_of_a_height_and_repeat() -> None:
    slope = crease_slopes().astype(np.float64)
    assert (slope**2).sum(axis=-1).mean() == pytest.approx(1)
    turned = np.fft.fftn(slope, axes=(0, 1, 2))
    waves = np.stack(np.meshgrid(*(np.fft.fftfreq(CELLS),) * 3, indexing="ij"), axis=-1)
    curl = np.abs(np.cross(waves, turned)).max(axis=-1)[(waves > -0.5).all(axis=-1)]  # the shortest have no direction
    assert curl.max() < 1e-5 * np.abs(turned).max()
    point = np.float32([[0.1, -0.3, 0.8], [0.1 + PERIOD_M, -0.3, 0.8], [0.1, -0.3, 0.8]])
    rays = np.float32([[0, 0, -1], [0, 0, -1], [0, 0, 1]])
    normal = np.tile(np.float32([0, 0, 1]), (3, 1))
    crease(point, rays, 0.2, crease_slopes(), np.arange(3), normal)
    assert np.allclose(normal[0], normal[1], atol=1e-4)
    assert normal[0, 2] < 1
    assert normal[2, 2] == 1  # it would lean away from the eye


def test_a_panes_cells_are_no_tiles() -> None:
    """A pane half covered, in two cells: across it the view fades into the cover, even from pixel to pixel."""
    bare = scene_of(box_room(), uniform_sky(1000.0, ground=1.0), 0.5)
    clear, veil = np.array([[1.0, 0.0]], np.float32), np.zeros((1, 2, 3), np.float32)
    stage = Stage.of(replace(bare, panes=(replace(bare.panes[0], clear=clear, veil_cd_m2=veil),)))
    sight = sight_of(stage, Perspective(400, 40, 1.2, yaw_rad=np.pi), EYE)
    row = seen_outdoors(stage, sight)[:, 0].reshape(sight.shape)[20]
    row = row[(sight.label == GLASS).reshape(sight.shape)[20]]
    assert len(row) > 200
    assert row.max() > 0.9 * 1000
    assert row.min() < 1
    assert np.abs(np.diff(row)).max() < 0.02 * 1000
