"""Every kind of furniture: within its size, closed, with normals that agree with its faces."""

from __future__ import annotations

import collections
import math

import numpy as np
import pytest

from mocks.rooms.finish import draw_finish
from mocks.rooms.furniture import MODELS, item_parts
from mocks.rooms.furniture.small import blade, leaf
from mocks.rooms.model import ADE20K, NO_CLASS, Item, Part, Role, Use
from processing.ground.mesh import Mesh, merge
from processing.ground.shapes import ball, beam, cylinder, lathe, pad, pillow, rounded_box, tube
from tests.conftest import LONG

SIZES_M = {
    "bed": (1.68, 2.12, 1.0),
    "nightstand": (0.45, 0.4, 0.5),
    "wardrobe": (1.5, 0.6, 2.1),
    "chest of drawers": (0.9, 0.45, 0.85),
    "cabinet": (1.6, 0.42, 0.6),
    "bookcase": (0.85, 0.3, 1.95),
    "wall shelf": (0.9, 0.2, 0.28),
    "sofa": (2.1, 0.92, 0.84),
    "armchair": (0.8, 0.82, 0.8),
    "ottoman": (0.5, 0.5, 0.42),
    "chair": (0.45, 0.52, 0.84),
    "swivel chair": (0.64, 0.64, 1.05),
    "dining table": (1.6, 0.9, 0.75),
    "coffee table": (1.1, 0.6, 0.42),
    "desk": (1.4, 0.7, 0.74),
    "floor lamp": (0.42, 0.42, 1.6),
    "table lamp": (0.26, 0.26, 0.46),
    "television": (1.1, 0.24, 0.69),
    "monitor": (0.6, 0.2, 0.47),
    "laptop": (0.34, 0.33, 0.235),
    "keyboard": (0.56, 0.14, 0.032),
    "vase": (0.18, 0.18, 0.28),
    "bottle": (0.076, 0.076, 0.3),
    "bowl": (0.25, 0.25, 0.09),
    "mug": (0.115, 0.085, 0.095),
    "box": (0.4, 0.3, 0.3),
    "basket": (0.38, 0.38, 0.34),
    "toy blocks": (0.5, 0.5, 0.08),
    "toy ball": (0.2, 0.2, 0.2),
    "books": (0.22, 0.28, 0.1),
    "plant": (0.6, 0.6, 1.1),
    "picture": (0.7, 0.025, 0.5),
    "wall clock": (0.3, 0.04, 0.3),
    "rug": (2.0, 1.4, 0.012),
    "cushion": (0.45, 0.28, 0.45),
    "blanket": (0.6, 0.42, 0.075),
    "tripod": (0.82, 0.82, 1.52),
    "meter board": (0.5, 0.4, 1.3),
}
TOLERANCE_M = {"plant": 0.06}
"""Beyond the usual 2 cm: the tips of leaves, which bend."""
TRIANGLES = 7500
SHAPES = {
    "rounded box": lambda: rounded_box((-0.2, -0.1, 0.0), (0.3, 0.2, 0.4), 0.02, 2, (3, 1, 2)),
    "beam": lambda: beam((0.1, 0.2, 0.0), (0.4, -0.1, 0.7), 0.05, 0.02),
    "tube": lambda: tube([(0, 0, 0), (0.1, 0, 0.3), (0.3, 0.2, 0.4)], (0.02, 0.03, 0.01)),
    "cylinder": lambda: cylinder((0.1, 0.2, 0.3), 0.1, 0.5, 0.01),
    "lathe": lambda: lathe([(0.0, 0.0), (0.1, 0.0), (0.12, 0.2), (0.05, 0.3), (0.0, 0.3)]),
    "ball": lambda: ball((0, 0, 0), 0.2),
    "pad": lambda: pad((-0.4, -0.3, 0.1), (0.4, 0.3, 0.3), 0.05, 0.02),
    "pillow": lambda: pillow((0.6, 0.4, 0.15)),
    "leaf": lambda: leaf(0.2, 0.1, 1.0),
    "blade": lambda: blade(0.5, 0.06, 0.1, 0.2),
}


def built(kind: str, seed: int, **options: float) -> list[Part]:
    finish = draw_finish(np.random.default_rng(seed), Use.LIVING)
    size = SIZES_M[kind]
    if options.get("round"):
        size = (size[1], size[1], size[2])
    item = Item(kind, Role.FURNITURE, 3, (0.0, 0.0, 0.0), size, 0.0, seed, tuple(options.items()))
    return item_parts(item, finish)


def assert_sound(mesh: Mesh) -> None:
    for values in (mesh.vertices, mesh.normals, mesh.uv):
        assert np.isfinite(values).all()
    np.testing.assert_allclose(np.linalg.norm(mesh.normals[np.unique(mesh.faces)], axis=1), 1.0, atol=1e-9)
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    agree = np.einsum("fi,fki->fk", across, mesh.normals[mesh.faces])
    assert (agree.sum(axis=1) > 0).all(), f"{(agree.sum(axis=1) <= 0).sum()} faces look away from their normals"


def volume_m3(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6)


def open_edges(mesh: Mesh) -> int:
    """Count the edges that are not passed once in each direction."""
    _, place = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)
    faces = place.reshape(-1)[mesh.faces]
    passed: collections.Counter[tuple[int, int]] = collections.Counter()
    for a, b in ((0, 1), (1, 2), (2, 0)):
        passed.update(zip(faces[:, a].tolist(), faces[:, b].tolist(), strict=True))
    return sum(passed[b, a] != n for (a, b), n in passed.items() if a != b)


@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_is_a_closed_body_whose_normals_point_out(name: str) -> None:
    mesh = SHAPES[name]()
    assert_sound(mesh)
    assert open_edges(mesh) == 0
    assert volume_m3(mesh) > 0


def test_shapes_have_the_volume_that_geometry_says() -> None:
    assert volume_m3(rounded_box((0, 0, 0), (1, 2, 3), 0.0)) == pytest.approx(6.0)
    assert volume_m3(cylinder((0, 0, 0), 0.5, 2.0, sides=200)) == pytest.approx(math.pi * 0.5, rel=1e-3)
    assert volume_m3(ball((1, 2, 3), 0.5, sides=120)) == pytest.approx(4 / 3 * math.pi / 8, rel=2e-3)
    assert volume_m3(tube([(0, 0, 0), (0, 3, 4)], 0.1, sides=200)) == pytest.approx(math.pi * 0.05, rel=1e-3)
    assert volume_m3(beam((0, 0, 0), (0, 3, 4), 0.2, 0.1, 0.0)) == pytest.approx(0.1)


def test_every_kind_is_tried_here() -> None:
    assert set(SIZES_M) == set(MODELS)


@pytest.mark.sweep
@pytest.mark.parametrize("kind", MODELS)
def test_models_are_sound_and_keep_to_their_size(kind: str) -> None:
    size, slack = np.array(SIZES_M[kind]), TOLERANCE_M.get(kind, 0.02)
    for seed in range(6 if LONG else 2):
        parts = built(kind, seed)
        for part in parts:
            assert_sound(part.mesh)
        whole = merge([part.mesh for part in parts])
        low, high = whole.vertices.min(axis=0), whole.vertices.max(axis=0)
        assert (low >= [-size[0] / 2 - slack, -size[1] / 2 - slack, -1e-9]).all(), (seed, low)
        assert (high <= [size[0] / 2 + slack, size[1] / 2 + slack, size[2] + slack]).all(), (seed, high)
        assert high[2] > 0.8 * size[2]
        assert low[2] < 0.005, "it must stand on the ground"
        assert len(whole.faces) <= TRIANGLES, (seed, len(whole.faces))


@pytest.mark.parametrize("kind", ["dining table", "coffee table", "rug"])
def test_round_ones_are_round(kind: str) -> None:
    whole = merge([part.mesh for part in built(kind, 1, round=1.0)])
    radius = np.hypot(whole.vertices[:, 0], whole.vertices[:, 1])
    assert radius.max() == pytest.approx(SIZES_M[kind][1] / 2, abs=1e-6)


def test_parts_say_what_they_belong_to() -> None:
    for kind in MODELS:
        parts = built(kind, 5)
        assert parts, kind
        for part in parts:
            assert part.surface == kind
            assert part.instance == 3
            assert part.ade in ADE20K.values() or part.ade == NO_CLASS
            assert (part.ade == NO_CLASS) == (kind in ("tripod", "meter board"))
            assert part.material.emission_cd_m2 == (0.0, 0.0, 0.0)


def test_the_same_item_is_the_same_mesh_and_another_seed_another() -> None:
    first, again, other = (merge([p.mesh for p in built("bookcase", seed)]) for seed in (4, 4, 5))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    assert first.vertices.shape != other.vertices.shape or not np.array_equal(first.vertices, other.vertices)


def test_an_item_stands_where_it_is_put() -> None:
    finish = draw_finish(np.random.default_rng(1), Use.LIVING)
    board = Item("meter board", Role.EQUIPMENT, 1, (1.0, 2.0, 0.0), SIZES_M["meter board"], math.pi / 2, 1)
    white = next(p for p in item_parts(board, finish) if p.material.colour == (0.90, 0.90, 0.90))
    # Unturned the board faces -y; a quarter turn later +x.
    front = white.mesh.normals[:, 0] > 0.999
    assert front.any()
    middle = white.mesh.vertices[front].mean(axis=0)
    np.testing.assert_allclose(middle[1:], [2.0, 1.05], atol=0.01)
    np.testing.assert_allclose(np.ptp(white.mesh.vertices[:, 1:], axis=0), [0.5, 0.5], atol=1e-6)
    assert white.material.roughness is None
