"""The cube of pictures around the camera: every direction has its place, and pixels their directions."""

import numpy as np
import pytest

from mocks.rooms.light.cube import FACES, Cube


def random_directions(count, seed=0):
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    return (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("face_px", [16, 48, 192])
def test_place_is_the_inverse_of_directions(face_px):
    cube = Cube(face_px)
    rays = random_directions(20_000)
    face, column, row = cube.place(rays)
    middle, step = (cube.side_px - 1) / 2, 2 / cube.face_px
    back = np.empty_like(rays)
    for index, (ahead, aside, above) in enumerate(np.array(FACES, float)):
        mine = face == index
        a, b = (column[mine] - middle) * step, (middle - row[mine]) * step
        back[mine] = ahead + a[:, None] * aside + b[:, None] * above
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    assert np.abs(back - rays).max() < 1e-5
    assert min(column.min(), row.min()) > cube.border_px - 1
    assert max(column.max(), row.max()) < cube.side_px - cube.border_px


def test_pixels_lie_where_place_says():
    cube = Cube(32)
    rays = cube.directions()
    inner = slice(cube.border_px, -cube.border_px)
    face, column, row = cube.place(rays[:, inner, inner].reshape(-1, 3))
    grid = np.arange(cube.border_px, cube.side_px - cube.border_px)
    assert (face.reshape(6, 32, 32) == np.arange(6)[:, None, None]).all()
    assert np.abs(column.reshape(6, 32, 32) - grid[None, None, :]).max() < 1e-3
    assert np.abs(row.reshape(6, 32, 32) - grid[None, :, None]).max() < 1e-3


def test_faces_fade_into_one_another_everywhere():
    cube = Cube(48)
    rays = random_directions(20_000, 1)
    weights = np.stack([cube.place_in(face, rays)[2] for face in range(6)])
    total = weights.sum(axis=0)
    assert total.min() > 0.4
    own = np.take_along_axis(weights, cube.place(rays)[0][None], axis=0)[0]
    assert (own >= 0.49 * weights.max(axis=0)).all()
    # Two directions a hair apart on either side of a border have the same weights.
    near = np.array([[1, 0.9999, 0.1], [0.9999, 1, 0.1]], np.float32)
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    pair = np.stack([cube.place_in(face, near)[2] for face in range(6)])
    assert np.abs(pair[:, 0] - pair[:, 1]).max() < 1e-2
