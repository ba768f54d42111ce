"""Pillows, covers and white surfaces: plump, closed, leaning back, outside of what they lie on; never paper white."""

from __future__ import annotations

import numpy as np
import pytest

from processing.ground.colour import luminance_cd_m2
from processing.layout.furniture.bench import STYLES, material, style_named
from processing.layout.furniture.builtin import BUILT_IN, build_model, design_of
from processing.layout.furniture.soft import MOST_OUT_M, hanging, pillow
from processing.layout.furniture.solids import Solid, corner_normals, signed_volume_m3
from processing.layout.furniture.verbs import add
from tests.processing.layout.test_furniture_models import albedo, assert_closed

SIZES = ((0.66, 0.43, 0.18), (0.50, 0.50, 0.17), (0.42, 0.42, 0.14), (0.44, 0.28, 0.12))
WHITEST = 0.75
"""Largest albedo of white paint and cotton: chosen, so that the sun leaves them their form in a picture."""


def bodies_of(style: str, category: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Solid]]:
    """Return a piece's bodies by the verb that made each, in the piece's frame."""
    from processing.layout.furniture import verbs
    from processing.layout.furniture.bench import Bench

    found: dict[str, list[Solid]] = {}
    current: list[str] = []
    plain = Bench.add

    def seen(self: Bench, body: Solid, *args: object, **values: object) -> None:
        if current:
            found.setdefault(current[-1], []).append(body)
        plain(self, body, *args, **values)  # type: ignore[arg-type]

    def named(bench: Bench, role: str, verb: str, **values: object) -> None:
        current.append(verb)
        add(bench, role, verb, **values)
        current.pop()

    monkeypatch.setattr(Bench, "add", seen)
    monkeypatch.setattr(verbs, "add", named)
    build_model.cache_clear()
    build_model(category, style)
    build_model.cache_clear()
    return found


def edge_radius_m(body: Solid, along: int) -> float:
    """Return the radius of the circle through a pillow's seam and the two sides 6 mm further in, at a side's middle."""
    v = body.vertices
    other = 1 - along
    strip = v[(np.abs(v[:, other]) < 0.1 * np.ptp(v[:, other])) & (v[:, along] > 0)]
    reach = strip[:, along].max()
    deep = reach - strip[:, along]
    inner = strip[(deep > 0.004) & (deep < 0.03)]
    half = np.abs(inner[:, 2])
    return float(np.median(((reach - inner[:, along]) ** 2 + half**2) / (2 * (reach - inner[:, along]))))


@pytest.mark.parametrize("size", SIZES)
def test_a_pillow_is_closed_and_round_at_its_edges(size: tuple[float, float, float]) -> None:
    """Its edges were knives, and its faces were flat."""
    body = pillow(*size, seed=2)
    assert signed_volume_m3(body.vertices, body.faces) > 0.45 * np.prod(size), "it is full"
    assert_closed(body.vertices, body.faces, "pillow")
    np.testing.assert_allclose(np.ptp(body.vertices, axis=0)[:2], size[:2], atol=0.01)
    for along in (0, 1):
        assert 0.018 < edge_radius_m(body, along) < 0.06, "an edge's radius is that of filled cloth"
    normals = corner_normals(body.vertices, body.faces, np.radians(80))
    turns = np.degrees(np.arccos(np.clip(np.einsum("fik,fjk->fij", normals, normals), -1, 1)))
    rim = np.abs(body.vertices[body.faces][..., 2]).min(axis=1) < 0.004
    assert np.percentile(turns[~rim].max(axis=(1, 2)), 99) < 40, "no facets show"


@pytest.mark.parametrize("style", STYLES)
def test_pillows_lean_back_and_lie_on_the_mattress(style: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """They leaned towards the foot, over the bed."""
    found = bodies_of(style, "bed", monkeypatch)
    mattress = found["pad"][-1] if len(found["pad"]) == 1 else max(found["pad"], key=lambda b: np.ptp(b.vertices[:, 1]))
    top, head = mattress.vertices[:, 2].max(), mattress.vertices[:, 1].min()
    pillows = found["pillow"]
    assert len(pillows) == 5
    for one in pillows:
        v = one.vertices
        upper, lower = (
            v[pick(v[:, 2])].mean(axis=0)
            for pick in (lambda z: z > np.quantile(z, 0.9), lambda z: z < np.quantile(z, 0.1))
        )
        assert upper[1] < lower[1] - 0.05, "its top is nearer to the head"
        assert top - 0.01 < v[:, 2].min() < top + 0.003, "it lies on the mattress"
        assert v[:, 1].min() > head - 0.012, "it is before the headboard"
    for number, one in enumerate(pillows):
        for other in pillows[:number]:
            assert depth_m(one, other) < 0.012, "they lean against each other"


def depth_m(one: Solid, other: Solid) -> float:
    """Return how deep two convex bodies are in each other along the direction in which they are least so, m."""
    ways = np.random.default_rng(1).normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    a, b = one.vertices @ ways.T, other.vertices @ ways.T
    return float(np.minimum(a.max(axis=0) - b.min(axis=0), b.max(axis=0) - a.min(axis=0)).min())


def test_sofa_pillows_lean_back(monkeypatch: pytest.MonkeyPatch) -> None:
    for style in STYLES:
        for one in bodies_of(style, "sofa", monkeypatch)["pillow"]:
            v = one.vertices
            high, low = v[v[:, 2] > np.quantile(v[:, 2], 0.9)], v[v[:, 2] < np.quantile(v[:, 2], 0.1)]
            assert high[:, 1].mean() < low[:, 1].mean() - 0.05


@pytest.mark.parametrize("style", STYLES)
def test_no_mattress_comes_through_a_cover(style: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where folds went in, the mattress came out: scallops of another white along the sides."""
    found = bodies_of(style, "bed", monkeypatch)
    mattress = max(found["pad"], key=lambda b: np.ptp(b.vertices[:, 1]))
    low, high = mattress.vertices.min(axis=0), mattress.vertices.max(axis=0)
    cover = max(found["cover"], key=lambda b: np.ptp(b.vertices[:, 1])).vertices
    for side in (-1, 1):
        outer = cover[(side * cover[:, 0] > high[0] - 0.02) & (cover[:, 2] < high[2] - 0.06)]
        outer = outer[outer[:, 1] < high[1] - 0.05]
        columns = np.round(outer[:, 1] / 0.06).astype(int)
        reach = [side * outer[columns == c][:, 0] for c in np.unique(columns)]
        assert min(r.max() for r in reach) > high[0] + 0.002
    upper = cover[(np.abs(cover[:, 0]) < 0.4 * np.ptp(cover[:, 0])) & (cover[:, 2] > high[2])]
    assert len(upper) > 300
    assert cover[:, 1].max() > high[1] + 0.005
    assert low[2] < cover[:, 2].min(), "it ends above the mattress's underside"


def test_a_cover_is_crumpled_thick_and_has_a_round_hem() -> None:
    cover = hanging(1.4, 1.4, 0.21, 0.05, foot_drop_m=0.2)
    assert_closed(cover.vertices, cover.faces, "cover")
    flat = cover.vertices[(np.abs(cover.vertices[:, 0]) < 0.5) & (cover.vertices[:, 1] < 1.1)]
    upper = flat[flat[:, 2] > -0.03 - MOST_OUT_M / 2]
    assert 0.004 < upper[:, 2].std() < 0.02, "neither a board nor a heap"
    hem = cover.vertices[cover.vertices[:, 2] < cover.vertices[:, 2].min() + 0.05]
    sides = hem[(hem[:, 1] > 0.3) & (hem[:, 1] < 1.0) & (hem[:, 0] > 0)]
    assert np.ptp(sides[:, 0]) > 0.04, "folds and thickness"


def test_whites_are_no_whiter_than_paint_and_cotton_are() -> None:
    for style in STYLES:
        roles = style_named(style).roles
        for role, name in roles.items():
            if material(name).metallic == 0:
                shade = luminance_cd_m2(np.array([[albedo(material(name))]], np.float32))
                assert float(shade.max()) <= WHITEST, (style, role)
        rug = build_model("rug", style, None, design_of("rug", style)).parts
        for part in rug:
            assert max(albedo(part.material)) < 0.6, "sun on a rug kept no pattern"


def test_designs_named_by_styles_exist() -> None:
    for style in STYLES:
        for category, design in style_named(style).designs.items():
            assert design in BUILT_IN[category].designs, (style, category)
