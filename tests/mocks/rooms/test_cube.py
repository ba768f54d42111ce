"""The cube of pictures around the camera: every direction has its place, and pixels their directions."""

import math

import numpy as np
import pytest

from mocks.rooms.light.cube import FACES, Cube, Guide, facing_normals
from mocks.rooms.light.geometry import Geometry
from mocks.rooms.model import Material
from mocks.rooms.shell.surfaces import part_of
from mocks.rooms.view import CubeLookup, Seen
from processing.ground.shapes import lathe


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


def test_the_inside_of_a_lampshade_is_not_lit_like_its_outside() -> None:
    """It is hardly a pixel of the cube high: taken for the outside at both ends, a shade looked see-through."""
    profile = [(0.247, 0.4), (0.25, 0.4), (0.1, 0.6), (0.097, 0.6), (0.247, 0.4)]
    shade = part_of(lathe(profile, 40), Material("shade", (0.8, 0.8, 0.8)), "lamp", "light")
    eye = np.array([0.0, -2.3, 0.22], np.float32)
    geometry = Geometry([shade])
    guide = Guide.of(geometry, eye, Cube(192))
    picture = np.where(guide.normal[..., 2:] < 0, np.float32(10), np.float32(100)).repeat(3, axis=3)
    longitude, latitude = np.meshgrid(np.linspace(-0.1, 0.1, 160), np.linspace(0.06, 0.16, 160))
    rays = np.stack([np.sin(longitude) * np.cos(latitude), np.cos(longitude) * np.cos(latitude), np.sin(latitude)], -1)
    rays = rays.reshape(-1, 3).astype(np.float32)
    hits = geometry.cast(eye, rays)
    rays = rays[hits.face >= 0]
    hits = geometry.cast(eye, rays)
    normal = facing_normals(geometry, hits, rays)
    plane = (np.einsum("ij,ij->i", normal, rays) * hits.distance_m).astype(np.float32)
    seen = Seen(geometry.part_of[hits.face], normal, plane)
    (light,) = CubeLookup(guide).at(rays, seen, [picture])
    inside = normal[:, 2] < -0.3
    assert 50 < inside.sum() < 0.5 * len(inside)
    assert math.isclose(float(np.median(light[~inside])), 100, rel_tol=0.05)
    assert (light[inside] < 30).mean() > 0.9
