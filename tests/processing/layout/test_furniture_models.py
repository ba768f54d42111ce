"""Every built-in model in its smallest, usual and largest size: sound, exact, facing +y."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import daylit
from processing.errors import CatalogueError, ItemError
from processing.ground.colour import linear_of_srgb
from processing.layout.arrange import arrange
from processing.layout.arrangement import PlacedItem
from processing.layout.furniture.bench import STYLES
from processing.layout.furniture.builtin import BUILT_IN, build_model, design_of
from processing.layout.furniture.model import FurnitureModel, Material, bounds, noise, wood
from processing.layout.furniture.soft import hanging
from processing.layout.furniture.solids import signed_volume_m3
from processing.layout.items import KINDS, ItemSpec, parse_items
from processing.layout.models.catalogue import Catalogue, write_model
from processing.layout.models.mesh_files import RawPart
from processing.layout.models.mesh_pose import repaired
from processing.layout.plan import Door, make_plan
from processing.stages.furnishing import furniture_parts, scene_parts
from tests.conftest import LONG

MOST_TRIANGLES = 20_000


def assert_sound(model: FurnitureModel) -> None:
    low, high = bounds([part.vertices for part in model.parts])
    np.testing.assert_allclose(high - low, model.size_m, atol=1e-3)
    np.testing.assert_allclose((low + high)[:2] / 2, 0.0, atol=1e-3)
    assert abs(low[2]) < 1e-3, "stands on the floor"
    assert 100 < model.triangles <= MOST_TRIANGLES
    for part in model.parts:
        assert np.isfinite(part.vertices).all()
        np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1.0, atol=1e-4)
        assert part.faces.min() >= 0
        assert part.faces.max() < len(part.vertices)
        assert signed_volume_m3(part.vertices.astype(np.float64), part.faces.astype(np.int64)) > 0, part.material.name
        assert_closed(part.vertices, part.faces, part.material.name)
        assert (part.uv is not None) == (part.material.texture is not None)
        assert all(0 <= c <= 0.9 for c in albedo(part.material)), "no surface gives back more light than it gets"


def albedo(material: Material) -> tuple[float, ...]:
    """Return the mean base colour of a material, its texture included."""
    mean = 1.0 if material.texture is None else mean_colour(material.texture.tobytes())
    return tuple((np.array(material.base_colour) * mean).tolist())


@lru_cache
def mean_colour(texture: bytes) -> np.ndarray:
    """Return the mean (3,) of a texture's codes in linear light."""
    return linear_of_srgb(np.frombuffer(texture, np.uint8).reshape(-1, 3)).mean(axis=0)


def assert_closed(vertices: np.ndarray, faces: np.ndarray, name: str) -> None:
    """Each directed edge has its opposite, positions that coincide to 10 um being one."""
    key = np.rint(vertices * 1e5).astype(np.int64)
    mixed = key[:, 0] * 4_000_037 + key[:, 1] * 2_000_003_000_017 + key[:, 2]
    place = np.unique(mixed, return_inverse=True)[1][faces]
    edges = np.concatenate([place[:, [0, 1]], place[:, [1, 2]], place[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    n = len(vertices)
    assert np.array_equal(np.sort(edges[:, 0] * n + edges[:, 1]), np.sort(edges[:, 1] * n + edges[:, 0])), name


@pytest.mark.parametrize("design", BUILT_IN["books"].designs)
def test_a_high_pile_of_thin_books_is_of_books_to_its_top(design: str) -> None:
    assert_sound(build_model("books", STYLES[0], BUILT_IN["books"].largest_m, design))


def test_a_bed_cover_turns_down_round_and_hides_the_mattress_at_its_foot() -> None:
    """It was creased, and the mattress came through: bands of white, as of sheets that one sees through."""
    cover = hanging(1.4, 1.6, 0.21, 0.045, foot_drop_m=0.2, cells=(46, 42))
    corners = cover.vertices[cover.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    outer = (np.abs(corners[:, :, 0]).max(axis=1) < 0.3) & (normal @ (0, 0.7, 0.7) > 0.4)
    rises = np.degrees(np.arctan2(normal[outer, 2], normal[outer, 1]))
    assert np.histogram(rises, np.arange(5, 90, 10))[0].min() >= 4, "it faces every way between ahead and up"
    for style in STYLES:
        deep, high = 2.1, 0.95
        model = build_model("bed", style, (1.6, deep, high), design_of("bed", style))
        x, y, z = np.concatenate([part.vertices for part in model.parts]).T
        top = min(0.33, 0.45 * high)
        for left in np.arange(-0.5, 0.5, 0.1):
            foot = y[(x > left) & (x < left + 0.1) & (z > top + 0.03) & (z < top + 0.15)]
            assert deep / 2 > foot.max() > deep / 2 - 0.05, "cloth is beyond the mattress, and within the bed"


def test_the_two_prints_of_a_pair_differ() -> None:
    for style in STYLES:
        design = design_of("art", style)
        one, other = (
            next(
                p.material.texture
                for p in build_model("art", style, (w, 0.03, 0.45), design).parts
                if p.uv is not None and p.material.name == "print"
            )
            for w in (0.25, 0.252)
        )
        assert one is not None
        assert other is not None
        assert one.shape != other.shape or (one != other).mean() > 0.3


def test_no_dark_ground_shows_at_the_sides_of_slatted_doors() -> None:
    for category in ("wardrobe", "chest"):
        design = "slatted" if category == "wardrobe" else "sideboard"
        model = build_model(category, STYLES[1], None, design)
        dark = [part.vertices for part in model.parts if "dark" in part.material.name]
        assert dark, [part.material.name for part in model.parts]
        assert np.abs(np.concatenate(dark)[:, 0]).max() < model.size_m[0] / 2 - 0.005


@pytest.mark.sweep
@pytest.mark.parametrize("deep_m", [0.25, 0.3, 0.4] if LONG else [0.25, 0.3])
def test_books_stand_before_the_back_of_their_shelf(deep_m: float) -> None:
    """Piles stuck out of the back of shelves 0.3 m deep, upright books of those 0.25 m deep."""
    for design in BUILT_IN["bookshelf"].designs:
        model = build_model("bookshelf", STYLES[0], (1.2, deep_m, 2.1), design)
        books = [part.vertices for part in model.parts if part.material.name.startswith(("book", "paper"))]
        assert np.concatenate(books)[:, 1].min() > -deep_m / 2 + 0.025, design


@pytest.mark.sweep
@pytest.mark.parametrize("category", sorted(BUILT_IN))
def test_model_is_sound_in_every_size(category: str) -> None:
    kind = BUILT_IN[category]
    sizes = (None, kind.smallest_m, kind.largest_m)
    for number, design in enumerate(kind.designs):
        for size in sizes if number == 0 and LONG else sizes[number % 3 :][:1]:
            model = build_model(category, STYLES[number % 4], size, design)
            assert model.size_m == (size or kind.usual_m)
            assert_sound(model)


@pytest.mark.parametrize("category", sorted(BUILT_IN))
def test_designs_differ_in_shape_and_each_style_has_its_own(category: str) -> None:
    """Of one size and style, designs are of other parts and triangles; prints and rugs differ by pattern."""
    designs = list(BUILT_IN[category].designs)
    assert 3 <= len(designs) <= 4, "the guide says so"
    assert {design_of(category, style) for style in STYLES} <= set(designs)
    assert len({design_of(category, style) for style in STYLES}) >= 3
    if category == "rug":  # flat: their patterns differ
        return
    counts = [tuple(len(p.faces) for p in build_model(category, STYLES[0], None, design).parts) for design in designs]
    prints = category == "art"
    assert prints or len(set(counts)) == len(designs)


def test_lamps_send_out_their_lumens_only_when_lit() -> None:
    lamp = PlacedItem(id="l", category="table lamp", size_m=(0.28, 0.28, 0.46), theta_rad=0.0, t_m=(0.0, 0.0, 0.5))
    catalogue = Catalogue.builtin("mid-century")
    assert not any(sum(p.material.emission_cd_m2) for p in furniture_parts([lamp], catalogue))
    flux = 0.0
    for part in furniture_parts([lamp], catalogue, lit=True):
        a, b, c = (part.vertices_m[part.faces[:, k]] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        flux += np.pi * area * np.dot((0.2127, 0.7151, 0.0722), part.material.emission_cd_m2)
    assert flux == pytest.approx(400, rel=0.01)


def test_bedding_is_creased_and_wood_is_not() -> None:
    parts = scene_parts(build_model("bed", "scandinavian", (1.6, 2.1, 1.0)).parts)
    creases = {part.material.name: part.material.creases for part in parts}
    assert max(creases.values()) > 0.1
    assert creases["oak"] == 0


def test_kinds_that_a_folder_of_furniture_lacks_are_built_in(tmp_path: Path) -> None:
    write_model(tmp_path / "low.glb", Catalogue.builtin("classic").mesh("sofa/classic", (1.9, 0.9, 0.8)))
    (tmp_path / "catalog.json").write_text(json.dumps({"low.glb": {"category": "sofa", "front": "+z"}}))
    own = Catalogue.at(tmp_path)
    plan = make_plan([(-2, -2), (2, -2), (2, 2), (-2, 2)], doors=[Door(0, 1, 1.9)])
    items = arrange(plan, parse_items("sofa, desk", {**KINDS, **own.kinds()}), n=1).arrangements[0].items
    assert {item.category: item.model for item in items} == {"sofa": "low", "desk": "desk"}
    parts = furniture_parts(items, Catalogue.builtin("industrial"), own)
    desk = furniture_parts([one for one in items if one.category == "desk"], Catalogue.builtin("industrial"))
    assert {part.name for part in desk} < {part.name for part in parts}
    with pytest.raises(CatalogueError, match="no model 'lost'"):
        furniture_parts([items[0].model_copy(update={"model": "lost"})], Catalogue.builtin("industrial"), own)


def test_wood_runs_along_boards_at_true_scale() -> None:
    """A wardrobe's door is as wide in texture coordinates as in metres, its grain upright, in any size."""
    for size in ((1.2, 0.6, 2.0), (2.4, 0.65, 2.5)):
        parts = [p for p in build_model("wardrobe", "scandinavian", size).parts if p.material.name == "oak"]
        checked = 0
        for part in parts:
            assert part.uv is not None
            a, b, c = (part.faces[:, k] for k in range(3))
            place, uv = part.vertices.astype(float), part.uv.astype(float)
            seen = np.abs(part.normals[a, 1]) > 0.999  # fronts
            checked += int(seen.sum())
            for i, j in ((a, b), (b, c)):
                real, drawn = place[j[seen]] - place[i[seen]], uv[j[seen]] - uv[i[seen]]
                np.testing.assert_allclose(
                    np.linalg.norm(drawn, axis=1), np.linalg.norm(real, axis=1), rtol=0.02, atol=1e-3
                )
        assert checked


def test_every_kind_of_the_item_table_has_a_model() -> None:
    assert set(BUILT_IN) >= set(KINDS)
    for category, kind in BUILT_IN.items():
        usual = KINDS[category].size_m if category in KINDS else kind.usual_m
        assert all(a <= v <= b for a, v, b in zip(kind.smallest_m, usual, kind.largest_m, strict=True)), category


@pytest.mark.parametrize("category", ["sofa", "armchair", "dining chair", "desk chair", "bed"])
def test_backs_are_at_the_back(category: str) -> None:
    model = build_model(category, "scandinavian")
    points = np.concatenate([p.vertices for p in model.parts])
    upper = points[points[:, 2] > 0.85 * model.size_m[2]]
    assert upper[:, 1].mean() < -0.1 * model.size_m[1]


@pytest.mark.parametrize("category", ["chest", "wardrobe", "nightstand"])
def test_handles_are_at_the_front(category: str) -> None:
    model = build_model(category, "classic")
    metal = [p for p in model.parts if p.material.metallic == 1]
    points = np.concatenate([p.vertices for p in metal])
    assert points[:, 1].max() > 0.99 * model.size_m[1] / 2
    assert points[points[:, 2] > 0.5 * model.size_m[2]][:, 1].min() > 0.3 * model.size_m[1]


def test_legs_keep_their_thickness_when_a_table_grows() -> None:
    def leg_width(size: tuple[float, float, float]) -> float:
        model = build_model("dining table", "classic", size)
        points = np.concatenate([p.vertices for p in model.parts])
        foot = points[(points[:, 2] < 0.02) & (points[:, 0] > 0) & (points[:, 1] > 0)]
        return float(np.ptp(foot[:, 0]))

    assert leg_width((1.0, 0.7, 0.74)) == pytest.approx(leg_width((2.4, 1.1, 0.74)), rel=0.02)


def test_same_arguments_give_the_same_triangles_and_styles_differ() -> None:
    build_model.cache_clear()
    one = build_model("plant", "scandinavian", (0.5, 0.5, 1.0))
    build_model.cache_clear()
    two = build_model("plant", "scandinavian", (0.5, 0.5, 1.0))
    for a, b in zip(one.parts, two.parts, strict=True):
        assert np.array_equal(a.vertices, b.vertices)
    colours = {albedo(build_model("chest", style).parts[0].material) for style in STYLES}
    assert len(colours) == len(STYLES)


def test_textures_repeat_without_a_seam_and_keep_their_mean_colour() -> None:
    field = noise((128, 128), (20, 20), 1)
    inside = np.abs(np.diff(field, axis=0)).mean()
    assert np.abs(field[0] - field[-1]).mean() < 1.5 * inside
    picture = wood((0.5, 0.335, 0.185))
    from processing.ground.colour import linear_of_srgb

    np.testing.assert_allclose(linear_of_srgb(picture).mean(axis=(0, 1)), (0.5, 0.335, 0.185), rtol=0.02)


def test_catalogue_answers_for_names_sizes_and_limits() -> None:
    catalogue = Catalogue.builtin("mid-century")
    assert len(catalogue.entries) == len(BUILT_IN)
    assert catalogue.mesh("coffee-table").category == "coffee table"
    entry = catalogue.entry("bed/mid-century")
    assert entry.zones == KINDS["bed"].zones
    spec = entry.item_spec()
    assert isinstance(spec, ItemSpec)
    assert spec.model == "bed/mid-century"
    with pytest.raises(CatalogueError, match=r"0\.9 to 2 m wide"):
        catalogue.mesh("desk", (3.0, 0.6, 0.74))
    with pytest.raises(CatalogueError, match="nearest: sofa/mid-century"):
        catalogue.mesh("sofaa/mid-century")
    with pytest.raises(ItemError, match="there are: scandinavian"):
        Catalogue.builtin("baroque")


def test_choose_is_seeded_and_keeps_the_limit() -> None:
    catalogue = Catalogue.builtin()
    drawn = {catalogue.choose("sofa", seed=seed).model_id for seed in range(12)}
    assert len(drawn) > 1
    assert catalogue.choose("sofa", seed=3) == catalogue.choose("sofa", seed=3)
    with pytest.raises(CatalogueError, match="none of 4 models"):
        catalogue.choose("sofa", largest_m=(1.0, 1.0, 1.0))
    with pytest.raises(CatalogueError, match="no harp here"):
        catalogue.choose("harp")


def test_repair_finds_nothing_to_repair_in_our_own() -> None:
    """The loader's repair and the builder agree on what outward is."""
    part = build_model("nightstand", "scandinavian").parts[0]
    sound = repaired(RawPart(part.vertices.astype(float), part.faces.astype(np.int64), None, part.material), 1.0)
    assert sound is not None
    assert sound.turned == 0


def test_the_list_as_json_names_each_zone_and_its_rule(capsys: pytest.CaptureFixture[str]) -> None:
    assert daylit.main(["furniture", "list", "--style", STYLES[0], "--category", "bed", "--json"]) == 0
    (bed,) = json.loads(capsys.readouterr().out)["models"]
    assert bed["zones"][-1] == {"side": "front", "rule": "bed_foot"}
