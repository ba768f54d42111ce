"""Loaded furniture: units, axes, winding, textures, 3D-FUTURE's form, GLB out and in again."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from benchmarks.shared_data import DATA
from processing.errors import CatalogueError, ModelFileError
from processing.layout.arrangement import Arrangement, PlacedItem
from processing.layout.furniture.solids import signed_volume_m3
from processing.layout.models.catalogue import Catalogue, category_of, in_place, write_arrangement, write_model


def chair(size: tuple[float, float, float] = (0.45, 0.5, 0.9)) -> tuple[np.ndarray, np.ndarray]:
    """A seat and a back, z up, the back at -y: triangles of two closed boxes."""
    w, d, h = size
    seat = trimesh.creation.box((w, d, 0.05 * h))
    seat.apply_translation((0, 0, 0.475 * h))
    back = trimesh.creation.box((w, 0.1 * d, h))
    back.apply_translation((0, -0.45 * d, h / 2))
    both = trimesh.util.concatenate([seat, back])
    return np.asarray(both.vertices), np.asarray(both.faces)


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray, head: str = "", face_lines: str = "") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [head, *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices)]
    lines.append(face_lines or "\n".join(f"f {a} {b} {c}" for a, b, c in faces + 1))
    path.write_text("\n".join(lines) + "\n")
    return path


def to_y_up(vertices: np.ndarray) -> np.ndarray:
    """From z up, front +y to y up, front +z."""
    return np.column_stack([-vertices[:, 0], vertices[:, 2], vertices[:, 1]])


def loaded(folder: Path, name: str = "chair", **stated: str):  # type: ignore[no-untyped-def]
    if stated:
        (file,) = folder.glob(f"{name}.*[!l]")
        (folder / "catalog.json").write_text(json.dumps([{"file": file.name, **stated}]))
    return Catalogue.at(folder).mesh(name)


def assert_chair(model, size=(0.45, 0.5, 0.9)) -> None:  # type: ignore[no-untyped-def]
    np.testing.assert_allclose(model.size_m, size, atol=1e-3)
    points = np.concatenate([p.vertices for p in model.parts])
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_allclose((low[0] + high[0], low[1] + high[1], low[2]), 0, atol=1e-3)
    assert points[points[:, 2] > 0.8 * size[2]][:, 1].max() < 0, "its back is at -y"
    for part in model.parts:
        assert signed_volume_m3(part.vertices.astype(float), part.faces.astype(np.int64)) > 0


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0), ("in", 1 / 0.0254)])
def test_units_are_estimated_from_the_size(tmp_path: Path, unit: str, factor: float) -> None:
    vertices, faces = chair()
    write_obj(tmp_path / "chair.obj", to_y_up(vertices) * factor, faces)
    model = loaded(tmp_path)
    assert_chair(model)
    assert any(f"taken to be in {unit}," in note for note in model.notes) == (unit != "m")


def test_unit_given_goes_before_the_guess_and_nonsense_is_scaled_and_said(tmp_path: Path) -> None:
    vertices, faces = chair()
    write_obj(tmp_path / "chair.obj", to_y_up(vertices) * 2.0, faces)
    assert loaded(tmp_path).size_m[2] == pytest.approx(1.8, abs=1e-3)
    assert loaded(tmp_path, unit="ft").size_m[2] == pytest.approx(1.8 * 0.3048, abs=1e-3)
    (tmp_path / "catalog.json").unlink()
    write_obj(tmp_path / "chair.obj", to_y_up(vertices) * 1e6, faces)
    odd = loaded(tmp_path)
    assert odd.size_m[2] == pytest.approx(0.9, rel=0.1)
    assert any("is unknown" in note for note in odd.notes)
    with pytest.raises(CatalogueError, match="unit 'furlong'"):
        loaded(tmp_path, unit="furlong")


def test_z_up_is_detected_where_proportions_are_clear(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.8, 0.3, 1.8))
    write_obj(tmp_path / "bookcase.obj", np.asarray(box.vertices), np.asarray(box.faces))
    model = loaded(tmp_path, "bookcase")
    np.testing.assert_allclose(model.size_m, (0.8, 0.3, 1.8), atol=1e-3)
    assert any("z is taken to point up" in note for note in model.notes)


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_front_is_found_from_the_back(tmp_path: Path, quarters: int) -> None:
    vertices, faces = chair()
    angle = quarters * math.pi / 2
    c, s = round(math.cos(angle)), round(math.sin(angle))
    turned = vertices @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]).T
    write_obj(tmp_path / "chair.obj", to_y_up(turned), faces)
    assert_chair(loaded(tmp_path))


@pytest.mark.parametrize(("front", "axis"), [("+z", 2), ("-z", 2), ("+x", 0), ("-x", 0)])
def test_front_given_is_taken(tmp_path: Path, front: str, axis: int) -> None:
    """A marker at the stated front of the file comes to +y."""
    body = trimesh.creation.box((0.6, 0.6, 0.6))
    marker = trimesh.creation.box((0.1, 0.1, 0.1))
    shift = np.zeros(3)
    shift[axis] = 0.35 if front[0] == "+" else -0.35
    marker.apply_translation(shift)
    both = trimesh.util.concatenate([body, marker])
    write_obj(tmp_path / "cabinet.obj", np.asarray(both.vertices), np.asarray(both.faces))
    model = loaded(tmp_path, "cabinet", front=front)
    points = np.concatenate([p.vertices for p in model.parts])
    tip = points[points[:, 1] > model.size_m[1] / 2 - 1e-3]
    assert np.ptp(tip[:, 0]) == pytest.approx(0.1, abs=1e-3)


def test_winding_is_turned_outward_and_said(tmp_path: Path) -> None:
    vertices, faces = chair()
    write_obj(tmp_path / "chair.obj", to_y_up(vertices), faces[:, ::-1])
    model = loaded(tmp_path)
    assert_chair(model)
    assert any("24 triangles wound inwards were turned" in note for note in model.notes)
    mixed = faces.copy()
    mixed[3:9] = mixed[3:9, ::-1]
    write_obj(tmp_path / "chair.obj", to_y_up(vertices), mixed)
    assert_chair(loaded(tmp_path))


def test_bad_vertices_and_flat_faces_are_left_out_and_said(tmp_path: Path) -> None:
    vertices, faces = chair()
    bad = np.concatenate([to_y_up(vertices), [[np.nan, 0, 0], [0.0, np.inf, 0]]])
    n = len(vertices)
    more = np.concatenate([faces, [[0, 1, n], [2, 3, n + 1], [0, 0, 1], [5, 5, 5]]])
    write_obj(tmp_path / "chair.obj", bad, more)
    model = loaded(tmp_path)
    assert_chair(model)
    text = " ".join(model.notes)
    assert "2 triangles with vertices that are no numbers were left out" in text
    assert "2 triangles without area were left out" in text


def test_open_surfaces_are_declared(tmp_path: Path) -> None:
    vertices, faces = chair()
    write_obj(tmp_path / "chair.obj", to_y_up(vertices), faces[2:])
    model = loaded(tmp_path)
    assert not model.closed
    assert model.parts[0].material.two_sided


def test_textures_and_their_absence(tmp_path: Path) -> None:
    vertices, faces = chair()
    Image.new("RGB", (8, 8), (200, 30, 30)).save(tmp_path / "Red.png")
    uvs = "vt 0 0\nvt 1 0\nvt 1 1\nmtllib chair.mtl\nusemtl a"
    lines = "\n".join(f"f {a}/1 {b}/2 {c}/3" for a, b, c in faces + 1)
    write_obj(tmp_path / "chair.obj", to_y_up(vertices), faces, uvs, lines)
    (tmp_path / "chair.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\nmap_Kd red.PNG\n")
    material = loaded(tmp_path).parts[0].material
    assert material.texture is not None
    assert material.texture[..., 0].mean() > 5 * material.texture[..., 1].mean()
    assert material.base_colour == (1.0, 1.0, 1.0)
    (tmp_path / "chair.mtl").write_text("newmtl a\nKd 0.5 0.5 0.5\nmap_Kd gone.png\n")
    model = loaded(tmp_path)
    assert model.parts[0].material.texture is None
    assert any("'gone.png' is missing" in note for note in model.notes)
    (tmp_path / "chair.mtl").unlink()
    assert any("'chair.mtl' is missing" in note for note in loaded(tmp_path).notes)


def test_relative_indices_count_from_the_end(tmp_path: Path) -> None:
    vertices, faces = chair()
    n = len(vertices)
    lines = "\n".join(f"f {a - n} {b - n} {c - n}" for a, b, c in faces)
    write_obj(tmp_path / "chair.obj", to_y_up(vertices), faces, face_lines=lines)
    assert_chair(loaded(tmp_path))


def test_catalog_json_goes_before_guesses(tmp_path: Path) -> None:
    vertices, faces = chair()
    write_obj(tmp_path / "thing.obj", to_y_up(vertices) * 7, faces)
    row = {"file": "thing.obj", "category": "dining chair", "size_m": [0.9, 1.0, 1.8], "front": "-z", "licence": "mine"}
    (tmp_path / "catalog.json").write_text(json.dumps({"thing": row}))
    entry = Catalogue.at(tmp_path).entry("thing")
    assert entry.category == "dining chair"
    assert entry.size_m == pytest.approx((0.9, 1.0, 1.8), rel=1e-3)
    assert entry.licence == "mine"
    assert entry.item_spec().zones[0].less_m == pytest.approx(1.0, rel=1e-3)
    (tmp_path / "catalog.json").write_text("[1, 2]")
    with pytest.raises(CatalogueError, match="not a table"):
        Catalogue.at(tmp_path)


def test_stretching_has_limits_and_keeps_normals_true(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.3)
    ball.export(tmp_path / "ottoman.glb")
    catalogue = Catalogue.at(tmp_path)
    model = catalogue.mesh("ottoman", (0.6, 0.6, 0.4))
    part = model.parts[0]
    middle = np.array([0, 0, 0.2])
    along = (part.vertices - middle) / np.array([0.3, 0.3, 0.2]) ** 2
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", along, part.normals).min() > 0.99
    with pytest.raises(CatalogueError, match="half or twice"):
        catalogue.mesh("ottoman", (2.0, 2.0, 2.0))
    with pytest.raises(CatalogueError, match="one way than another"):
        catalogue.mesh("ottoman", (1.1, 0.4, 0.6))


def test_3d_future_folder(tmp_path: Path) -> None:
    vertices, faces = chair()
    name = "0a1b2c3d-1111-4222-8333-444455556666"
    folder = tmp_path / "3D-FUTURE-model"
    write_obj(folder / name / "raw_model.obj", to_y_up(vertices), faces, "mtllib model.mtl\nusemtl m")
    write_obj(folder / name / "normalized_model.obj", to_y_up(vertices) / 0.9, faces)
    Image.new("RGB", (16, 16), (90, 60, 30)).save(folder / name / "texture.png")
    Image.new("RGB", (16, 16)).save(folder / name / "image.jpg")
    rows = [
        {
            "model_id": name,
            "super-category": "Chair",
            "category": "Dining Chair",
            "style": "Modern",
            "theme": None,
            "material": "Wood",
        },
        {"model_id": "../../etc", "super-category": "Sofa", "category": "Loveseat Sofa"},
        {"model_id": "missing-0000", "super-category": "Sofa", "category": "Loveseat Sofa"},
    ]
    (folder / "model_info.json").write_text(json.dumps(rows))
    catalogue = Catalogue.at(folder)
    assert catalogue.ids == (name,)
    entry = catalogue.choose("dining chair")
    assert entry.size_m == pytest.approx((0.45, 0.5, 0.9), abs=1e-3)
    assert "non-commercial" in entry.licence
    assert_chair(catalogue.mesh(name))
    assert Catalogue.at(folder).ids == (name,)
    (folder / "model_info.json").write_text("{}")
    with pytest.raises(CatalogueError, match="not a list"):
        Catalogue.at(folder)


@pytest.mark.parametrize(
    ("name", "category"),
    [
        ("loungeSofaLong", "sofa"),
        ("cabinetTelevisionDoors", "tv stand"),
        ("televisionModern", "tv"),
        ("bedsideTable2", "nightstand"),
        ("chairDesk", "desk chair"),
        ("lampRoundFloor", "floor lamp"),
        ("tableCoffeeGlass", "coffee table"),
        ("bedSingle", "single bed"),
        ("kitchenCabinet", "kitchen"),
        ("Winchester armchair", "armchair"),
        ("pottedPlant", "plant"),
        ("zzz", "other"),
        ("", "other"),
    ],
)
def test_categories_are_read_from_names(name: str, category: str) -> None:
    assert category_of(name) == category


def test_glb_of_a_model_comes_back_as_it_was(tmp_path: Path) -> None:
    model = Catalogue.builtin("mid-century").mesh("nightstand")
    path = tmp_path / "nightstand.glb"
    write_model(path, model)
    scene = trimesh.load_scene(path)
    width, depth, height = model.size_m
    np.testing.assert_allclose(scene.bounds, [(-width / 2, 0, -depth / 2), (width / 2, height, depth / 2)], atol=1e-4)
    again = loaded(tmp_path, "nightstand", front="-z")
    assert again.size_m == pytest.approx(model.size_m, abs=1e-4)
    metal = [p.material for p in again.parts if p.material.metallic == 1]
    assert metal
    assert any(p.material.texture is not None for p in again.parts)


@pytest.mark.parametrize(
    ("factors", "picture", "roughness", "metallic"),
    [
        ({}, None, 1.0, 1.0),  # glTF 2.0, 3.9.2: what is left out is 1
        ({"metallicFactor": 0.0}, None, 1.0, 0.0),  # cloth, as Blender writes it
        ({"roughnessFactor": 0.1}, None, 0.1, 1.0),  # chrome, likewise
        ({}, (255, 204, 0), 0.8, 0.0),  # wood: green is roughness, blue is metal
        ({"roughnessFactor": 0.5, "metallicFactor": 1.0}, (0, 204, 51), 0.4, 0.2),
    ],
)
def test_roughness_and_metal_are_gltfs(
    tmp_path: Path, factors: dict[str, float], picture: tuple[int, int, int] | None, roughness: float, metallic: float
) -> None:
    shown = None if picture is None else Image.fromarray(np.full((4, 4, 3), picture, np.uint8))
    colour = [0.5, 0.3, 0.2, 1.0]
    look = trimesh.visual.material.PBRMaterial(baseColorFactor=colour, metallicRoughnessTexture=shown, **factors)
    body = trimesh.creation.box((1.2, 0.7, 0.8))
    body.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(body.vertices), 2)), material=look)
    (tmp_path / "table.glb").write_bytes(trimesh.Scene([body]).export(file_type="glb"))
    (part,) = loaded(tmp_path, "table").parts
    assert (part.material.roughness, part.material.metallic) == pytest.approx((roughness, metallic), abs=0.01)


def test_arrangement_stands_in_the_rooms_axes(tmp_path: Path) -> None:
    def item(name: str, category: str, x: float, y: float, turn: float, size: tuple[float, float, float]) -> PlacedItem:
        return PlacedItem(id=name, category=category, model="gone", size_m=size, theta_rad=turn, t_m=(x, y, 0.0))

    chest = item("chest", "chest", 1.0, 2.0, math.pi / 2, (0.9, 0.45, 0.85))
    night = item("night", "nightstand", -1.0, 0.5, 0.0, (0.45, 0.40, 0.50))
    both = Arrangement(rank=1, items=(chest, night), score=1.0, scores={}, rule_set="standard")
    models = write_arrangement(tmp_path / "room.glb", both, Catalogue.builtin("scandinavian"))
    assert "the built-in chest instead" in models[0].notes[-1]
    scene = trimesh.load_scene(tmp_path / "room.glb")
    low, high = scene.bounds
    # x stays, z up is y, y is -z; turned by 90 degrees the chest's width lies along y.
    np.testing.assert_allclose(low, (-1.225, 0.0, -2.45), atol=1e-3)
    np.testing.assert_allclose(high, (1.225, 0.85, -0.3), atol=1e-3)
    front = np.concatenate([p.vertices for p in in_place(chest, models[0])])
    assert front[:, 0].min() == pytest.approx(0.775, abs=1e-3)


@pytest.mark.shared("furniture")
def test_shared_furniture_loads() -> None:
    kit = Catalogue.at(DATA / "furniture" / "kenney-furniture-kit")
    assert len(kit.entries) == len(kit.ids) >= 80
    assert not kit.refused
    assert {"sofa", "bed", "bookshelf", "desk", "tv", "rug", "floor lamp"} <= {e.category for e in kit.entries}
    blend = Catalogue.at(DATA / "furniture" / "blendswap-cc0")
    assert len(blend.ids) >= 45
    model = blend.mesh("bed1")
    assert model.category == "bed"
    assert model.size_m == pytest.approx((1.407, 2.08, 0.955), rel=0.03)
    assert any("points outside the folder" in note for note in model.notes)


def test_a_folder_without_models_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CatalogueError, match=r"no \.glb"):
        Catalogue.at(tmp_path)
    with pytest.raises(CatalogueError, match="no such folder"):
        Catalogue.at(tmp_path / "absent")
    (tmp_path / "bad.obj").write_text("nothing")
    catalogue = Catalogue.at(tmp_path)
    assert catalogue.entries == ()
    assert isinstance(catalogue.refused["bad"], ModelFileError)


@pytest.mark.parametrize(
    ("said", "name", "category", "noted"),
    [
        ("Nightstands", "", "nightstand", False),
        ("tv_stand", "", "tv stand", False),
        ("Couch", "", "sofa", False),
        ("Loveseat Sofa", "", "sofa", False),
        ("chair", "swivel chair", "desk chair", False),
        ("chair", "", "dining chair", False),
        ("Meuble", "velvet armchair", "armchair", True),
        ("Meuble", "", "other", True),
    ],
)
def test_stated_categories_are_understood_by_their_words_or_said(
    tmp_path: Path, said: str, name: str, category: str, noted: bool
) -> None:
    write_obj(tmp_path / "thing.obj", to_y_up(chair()[0]), chair()[1])
    (tmp_path / "catalog.json").write_text(json.dumps({"thing.obj": {"category": said, "name": name}}))
    entry = Catalogue.at(tmp_path).entry("thing")
    assert entry.category == category
    assert any(said.lower() in note and "not known" in note for note in entry.notes) is noted


def test_files_of_one_name_are_two_models(tmp_path: Path) -> None:
    vertices, faces = chair()
    write_obj(tmp_path / "chair.obj", to_y_up(vertices), faces)
    write_obj(tmp_path / "chair" / "chair.obj", to_y_up(vertices), faces)
    trimesh.Trimesh(to_y_up(vertices), faces).export(tmp_path / "chair.glb")
    catalogue = Catalogue.at(tmp_path)
    assert len(catalogue.ids) == len(catalogue.entries) == 3
    assert sum(any("another file is called chair" in note for note in e.notes) for e in catalogue.entries) == 2


def test_a_broken_model_of_a_placed_piece_is_replaced_and_said(tmp_path: Path) -> None:
    (tmp_path / "chest.glb").write_bytes(b"glTF but not really")
    chest = PlacedItem(
        id="chest", category="chest", model="chest", size_m=(0.9, 0.45, 0.85), theta_rad=0.0, t_m=(0.0, 0.0, 0.0)
    )
    one = Arrangement(rank=1, items=(chest,), score=1.0, scores={}, rule_set="standard")
    models = write_arrangement(tmp_path / "room.glb", one, Catalogue.at(tmp_path))
    assert "the built-in chest instead" in models[0].notes[-1]
