"""A scene as GLB, read by two other programs: trimesh (geometry, colours) and pygltflib (structure)."""

from __future__ import annotations

import io
import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from processing.exchange.gltf import finely, scene_glb, write_scene_glb
from processing.ground.room_model import Opening, OpeningKind, RoomModel
from processing.light.scene.scene import Part, Scene, Sun
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular, directions
from processing.surfaces.maps import surface_maps
from studio.build import node_and_npm
from tests.processing.light.rooms import box, box_room, scene_of, uniform_sky


def textured(name: str) -> np.ndarray:
    """Red grows along u, green along v."""
    v, u = np.meshgrid(np.linspace(0.1, 0.9, 48), np.linspace(0.1, 0.9, 64), indexing="ij")
    return np.stack([u, v, np.full_like(u, 0.3)], axis=-1).astype(np.float32)


def furnished() -> Scene:
    sun = Sun((0.0, -0.6, 0.8), (9e4, 9e4, 8e4))
    room = scene_of(box_room(), uniform_sky(sun=sun), albedo=textured, reveal_m=0.2)
    table = box((1.0, 0.5, 0.4), (1.2, 0.6, 0.8), colour=(0.5, 0.3, 0.2), name="table")
    lamp = box((-1.0, 1.0, 1.5), (0.2, 0.2, 0.2), name="lamp", emission_cd_m2=(3000.0, 2500.0, 2000.0))
    return room.furnished((table, lamp))


def loaded(data: bytes) -> Any:
    return trimesh.load(io.BytesIO(data), file_type="glb")


def test_a_second_loader_finds_all_where_it_is() -> None:
    scene = furnished()
    found = loaded(scene_glb(scene))
    assert set(found.geometry) == {s.name for s in scene.surfaces} | {"table", "lamp", "pane-0"}
    low, high = found.geometry["table"].bounds
    np.testing.assert_allclose(low, (0.4, 0.0, -0.8), atol=1e-6)
    np.testing.assert_allclose(high, (1.6, 0.8, -0.2), atol=1e-6)
    np.testing.assert_allclose(found.geometry["floor"].bounds[:, 1], 0, atol=1e-6)
    np.testing.assert_allclose(found.geometry["ceiling"].bounds[:, 1], 2.7, atol=1e-6)


WEB = Path(__file__).parents[3] / "studio" / "web"
VALIDATE = """
const { readFileSync } = require("fs");
require("gltf-validator").validateBytes(new Uint8Array(readFileSync(process.argv[1])))
  .then((found) => console.log(JSON.stringify(found.issues)));
"""


def issues_of(path: Path) -> dict[str, Any]:
    """What Khronos' own validator finds."""
    if not (WEB / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("gltf-validator is not installed: make web")
    node, _ = node_and_npm()
    command = [node, "-e", VALIDATE, str(path)]
    result: dict[str, Any] = json.loads(subprocess.run(command, cwd=WEB, capture_output=True, check=True).stdout)
    return result


@pytest.mark.parametrize("bare", [True, False])
def test_khronos_validator_finds_nothing_wrong(tmp_path: Path, bare: bool) -> None:
    scene = scene_of(box_room(), uniform_sky()) if bare else furnished()
    write_scene_glb(tmp_path / "room.glb", scene, None if bare else (0.0, 0.0, 1.6))
    found = issues_of(tmp_path / "room.glb")
    assert (found["numErrors"], found["numWarnings"]) == (0, 0), found["messages"]


def test_the_validator_finds_what_is_wrong(tmp_path: Path) -> None:
    data = scene_glb(furnished())
    (tmp_path / "cut.glb").write_bytes(data[: len(data) - 400])
    assert issues_of(tmp_path / "cut.glb")["numErrors"] > 0


def test_surfaces_face_inwards_and_leave_the_window_free() -> None:
    found = loaded(scene_glb(furnished()))
    middle = np.array([0.0, 1.3, 0.0])
    for name in ("floor", "ceiling", "wall-0", "wall-1", "wall-2", "wall-3"):
        mesh = found.geometry[name]
        assert (((middle - mesh.triangles_center) * mesh.face_normals).sum(axis=1) > 0).all(), name
        np.testing.assert_allclose(mesh.vertex_normals[mesh.faces[:, 0]], mesh.face_normals, atol=1e-5)
    assert found.geometry["wall-0"].area == pytest.approx(5 * 2.7 - 2 * 1.5, rel=1e-6)
    assert found.geometry["table"].is_volume or found.geometry["table"].area == pytest.approx(4.32, rel=1e-6)


def test_a_texture_lies_as_the_albedo_does() -> None:
    scene = furnished()
    floor = next(s for s in scene.surfaces if s.name == "floor")
    mesh = loaded(scene_glb(scene)).geometry["floor"]
    picture = np.asarray(mesh.visual.material.baseColorTexture.convert("RGB"))
    # trimesh turns v over when it reads; so the picture's row is (1 - v).
    rows = np.clip(((1 - mesh.visual.uv[:, 1]) * picture.shape[0]).astype(int), 0, picture.shape[0] - 1)
    columns = np.clip((mesh.visual.uv[:, 0] * picture.shape[1]).astype(int), 0, picture.shape[1] - 1)
    shown = (picture[rows, columns] / 255.0) ** 2.2
    world = np.column_stack([mesh.vertices[:, 0], -mesh.vertices[:, 2], mesh.vertices[:, 1]])
    offset = world - floor.origin_m
    u, v = offset @ floor.u_axis / floor.width_m, offset @ floor.v_axis / floor.height_m
    np.testing.assert_allclose(shown[:, 0], 0.1 + 0.8 * u, atol=0.06)
    np.testing.assert_allclose(shown[:, 1], 0.1 + 0.8 * v, atol=0.06)


def test_structure_is_glTF(tmp_path: Path) -> None:
    gltf = pytest.importorskip("pygltflib", reason="the second reader of glTF is not installed")
    path = tmp_path / "room.glb"
    write_scene_glb(path, furnished())
    read = gltf.GLTF2().load(str(path))
    assert read.asset.version == "2.0"
    assert read.asset.extras["sun"]["towards"] == pytest.approx([0.0, 0.8, 0.6])
    assert set(read.extensionsUsed) == {"KHR_lights_punctual", "KHR_materials_emissive_strength"}
    materials = {m.name: m for m in read.materials}
    assert not materials["wall-0"].doubleSided
    assert materials["pane-0"].alphaMode == "BLEND"
    lamp = materials["lamp"]
    assert lamp.extensions["KHR_materials_emissive_strength"]["emissiveStrength"] == pytest.approx(3000)
    assert lamp.emissiveFactor == pytest.approx([1.0, 2500 / 3000, 2000 / 3000])
    assert materials["table"].pbrMetallicRoughness.baseColorFactor == pytest.approx([0.5, 0.3, 0.2, 1.0])
    blob = read.binary_blob()
    for accessor in read.accessors:
        view = read.bufferViews[accessor.bufferView]
        each = {5123: 2, 5125: 4, 5126: 4}[accessor.componentType]
        size = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor.type] * each * accessor.count
        assert view.byteLength == size
        assert view.byteOffset % 4 == 0
        assert view.byteOffset + size <= len(blob)


def test_pieces_are_groups_and_camera_and_sun_are_where_they_were() -> None:
    parts = [
        box((1.0, y, 0.4), (0.2, 0.2, 0.8), name=name) for y, name in enumerate(("bed: oak", "bed: linen", "desk"))
    ]
    found = loaded(scene_glb(furnished().furnished(tuple(parts)), eye_m=(0.0, 0.0, 1.6)))
    graph = found.graph.transforms.children
    assert set(graph[found.graph.base_frame]) >= {"room", "bed", "desk", "table", "camera", "sun"}
    assert len(graph["bed"]) == 2
    assert {"floor", "wall-0", "pane-0"} <= set(graph["room"])
    np.testing.assert_allclose(found.graph.get("camera")[0], [[1, 0, 0, 0], [0, 1, 0, 1.6], [0, 0, 1, 0], [0, 0, 0, 1]])
    # A light shines along its node's -z; the sun is at (0, -0.6, 0.8) in our frame.
    np.testing.assert_allclose(found.graph.get("sun")[0][:3, :3] @ (0, 0, -1), (0, -0.8, -0.6), atol=1e-9)


def test_the_sun_is_a_light_of_the_file_in_lux(tmp_path: Path) -> None:
    gltf = pytest.importorskip("pygltflib", reason="the second reader of glTF is not installed")
    write_scene_glb(tmp_path / "room.glb", furnished(), (0.0, 0.0, 1.6))
    read = gltf.GLTF2().load(str(tmp_path / "room.glb"))
    (light,) = read.extensions["KHR_lights_punctual"]["lights"]
    assert light["type"] == "directional"
    # A viewer's light is colour times intensity: the sun's own, channel by channel, as lamps' `emissiveStrength`.
    assert np.array(light["color"]) * light["intensity"] == pytest.approx([9e4, 9e4, 8e4])
    assert max(light["color"]) == pytest.approx(1.0)
    assert 50 < np.degrees(read.cameras[0].perspective.yfov) < 75
    behind = Scene((), (), uniform_sky(sun=Sun((0.0, 1.0, 0.0), (1.0, 1.0, 1.0))), (box((0, 0, 1), (1, 1, 1)),))
    turn = loaded(scene_glb(behind)).graph.get("sun")[0]
    np.testing.assert_allclose(turn[:3, :3] @ (0, 0, -1), (0, 0, 1), atol=1e-6)


def test_the_models_walls_are_as_fine_as_the_panorama() -> None:
    """Stripes of 3 cm on a wall, in the panorama's light only: they are in the model's wall, whose mean stays."""
    room, geometry = box_room(), Equirectangular(1600, 800)
    scene = scene_of(room, uniform_sky(), albedo=lambda _: np.full((20, 30, 3), 0.5, np.float32))
    maps, (d, _) = surface_maps(room, geometry), directions(geometry)
    points = d * maps.depth_m[..., None]
    light = np.where((points[..., 2] / 0.06) % 1 < 0.5, 60.0, 90.0)[..., None].repeat(3, axis=-1).astype(np.float32)
    whole = np.zeros((800, 1600), np.uint8)
    image = LuminanceImage(light, np.full((800, 1600), 0.01, np.float32), whole, geometry, scale_uncertainty=0.01)
    wall = next(s for s in finely(scene, image, room).surfaces if s.name == "wall-2")
    near_m = abs(float((np.array([0.0, 0.0, room.camera_height_m]) - wall.origin_m) @ wall.normal))
    assert wall.albedo.shape[1] / wall.width_m == pytest.approx(min(220, 800 / np.pi / near_m), rel=0.02)
    middle = wall.albedo[:, wall.albedo.shape[1] // 2, 0]
    assert wall.albedo.mean() == pytest.approx(0.5, rel=0.04)
    assert middle[len(middle) // 4 : -len(middle) // 4].std() > 0.05, "the stripes are there"


def test_large_textures_are_averaged_down(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("processing.exchange.gltf.MOST_PX", 40)
    found = loaded(scene_glb(furnished()))
    assert found.geometry["wall-1"].visual.material.baseColorTexture.size == (40, 30)


def test_a_part_texture_repeats_from_the_lower_left_corner() -> None:
    texture = np.zeros((2, 2, 3), np.float32)
    texture[0, 0] = (1.0, 0.0, 0.0)
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float64)
    part = box((0, 0, 1), (1, 1, 1))
    material = replace(part.material, texture=texture, colour=(0.5, 1.0, 1.0))
    uv = np.array([[0, 0], [2, 0], [2, 2], [0, 2]], np.float32)
    card = Part("card", square, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material, uv)
    found = loaded(scene_glb(Scene((), (), uniform_sky(), (card,)))).geometry["card"]
    material = found.visual.material
    assert np.asarray(material.baseColorTexture.convert("RGB"))[0, 0].tolist() == [255, 0, 0]
    top_left = found.visual.uv[np.abs(found.vertices - (0, 1, 0)).max(axis=1) < 1e-9]
    np.testing.assert_allclose(top_left, [[0, 2]], atol=1e-6)
    np.testing.assert_allclose(np.asarray(material.baseColorFactor) / 255, (0.5, 1, 1, 1), atol=0.01)


def test_empty_walls_and_degenerate_triangles_do_not_break_the_file() -> None:
    room = scene_of(box_room(window=(0.0, 5.0, 0.0, 2.7)), uniform_sky())
    flat = Part("flat", np.zeros((3, 3)), np.array([[0, 1, 2]], np.int32), box((0, 0, 0), (1, 1, 1)).material)
    found = loaded(scene_glb(room.furnished((flat,))))
    assert "wall-0" not in found.geometry
    assert "pane-0" in found.geometry
    assert all(np.isfinite(g.vertices).all() for g in found.geometry.values())


def test_pictures_in_the_file_are_pictures() -> None:
    data = scene_glb(furnished())
    at = data.index(b"\xff\xd8\xff")
    with Image.open(io.BytesIO(data[at:])) as opened:
        assert opened.size == (64, 48)


def ball(rings: int = 12) -> Part:
    """A round part: shared vertices, and the normals of a sphere."""
    mesh = trimesh.creation.uv_sphere(radius=0.5, count=(rings, 2 * rings))
    material = box((0, 0, 0), (1, 1, 1)).material
    places = np.asarray(mesh.vertices, np.float64)
    return Part(
        "ball",
        places + np.array([0.0, 0.0, 1.0]),
        np.asarray(mesh.faces, np.int32),
        material,
        None,
        (2 * places).astype("f4"),
    )


def test_round_parts_keep_their_normals_and_share_their_corners() -> None:
    part = ball()
    found = loaded(scene_glb(Scene((), (), uniform_sky(), (part,)))).geometry["ball"]
    outwards = found.vertices - (0, 1, 0)
    np.testing.assert_allclose(found.vertex_normals, outwards / 0.5, atol=1e-3)
    assert len(found.vertices) <= len(part.vertices_m)
    assert len(found.faces) == len(part.faces)


def test_wrong_normals_are_not_written() -> None:
    part = ball()
    across = np.cross(part.normals, (0.3, 0.2, 0.9)).astype(np.float32)
    found = loaded(scene_glb(Scene((), (), uniform_sky(), (replace(part, normals=across),)))).geometry["ball"]
    sides = found.vertex_normals[found.faces[:, 0]]
    assert ((sides * found.face_normals).sum(axis=1) > 0.9).all()


def test_a_box_has_four_corners_a_side_and_one_texture_is_written_once(tmp_path: Path) -> None:
    gltf = pytest.importorskip("pygltflib", reason="the second reader of glTF is not installed")
    texture = np.random.default_rng(2).uniform(0, 1, (40, 40, 3)).astype(np.float32)
    one = box((0, 0, 1), (1, 1, 1), name="one")
    uv = np.zeros((8, 2), np.float32)
    parts = tuple(replace(one, name=name, uv=uv, material=replace(one.material, texture=texture)) for name in "ab")
    path = tmp_path / "two.glb"
    write_scene_glb(path, Scene((), (), uniform_sky(), parts))
    read = gltf.GLTF2().load(str(path))
    assert len(read.images) == len(read.textures) == len(read.materials) == 1
    assert [read.accessors[mesh.primitives[0].attributes.POSITION].count for mesh in read.meshes] == [24, 24]
    assert path.stat().st_size < 12_000


def test_reveals_hang_on_their_wall_and_hold_their_glass() -> None:
    """Of an L-shaped room: each reveal begins on its window's outline in the wall, and ends on the pane's; none floats.

    Outlines are worked out here from corners and metres along the wall alone.
    """
    floor = ((2.5, -2.0), (2.5, 2.0), (0.0, 2.0), (0.0, 0.5), (-2.5, 0.5), (-2.5, -2.0))
    places = ((0, 1.0, 3.0, 0.9, 2.7), (2, 0.2, 1.3, 0.0, 2.1), (3, 0.1, 2.5, 0.9, 2.2), (5, 3.0, 4.9, 1.0, 2.0))
    windows = tuple(
        Opening(kind=OpeningKind.WINDOW, wall=w, start_m=a, end_m=b, sill_m=low, head_m=high)
        for w, a, b, low, high in places
    )
    room = RoomModel(source="given", floor=floor, camera_height_m=1.5, ceiling_height_m=2.7, openings=windows)
    found = loaded(scene_glb(scene_of(room, uniform_sky(), reveal_m=0.2))).geometry
    assert sum(name.startswith("reveal-") for name in found) == 4 * len(windows)
    for number, (wall, a, b, low, high) in enumerate(places):
        foot, to = np.array(floor[wall]), np.array(floor[(wall + 1) % len(floor)])
        along = (to - foot) / np.hypot(*(to - foot))
        outward = np.array([along[1], -along[0]])
        corners = [(a, low), (b, low), (b, high), (a, high)]
        inner = np.array([[*(foot + m * along), z] for m, z in corners])
        outer = inner + 0.2 * np.array([*outward, 0.0])
        made = [found[f"reveal-{number}-{side}"] for side in ("sill", "end", "head", "start")]
        for k, mesh in enumerate(made):
            wanted = np.array([inner[k], inner[(k + 1) % 4], outer[k], outer[(k + 1) % 4]])
            vertices = np.column_stack([mesh.vertices[:, 0], -mesh.vertices[:, 2], mesh.vertices[:, 1]])
            away = np.linalg.norm(vertices[:, None] - wanted[None], axis=2)
            assert away.min(axis=1).max() < 1e-5, "a reveal has no corner elsewhere"
            assert away.min(axis=0).max() < 1e-5, "nor lacks one"
        beside = (f"wall-{wall}", f"wall-{(wall + 1) % 6}", f"wall-{(wall - 1) % 6}", "ceiling", "floor")
        for names, rim in ((beside, inner), ((f"pane-{number}",), outer)):
            edge = np.concatenate([np.linspace(p, q, 9) for p, q in zip(rim, np.roll(rim, -1, axis=0), strict=True)])
            seen = np.column_stack([edge[:, 0], edge[:, 2], -edge[:, 1]])
            assert max(min(distance_m(found[name], place) for name in names) for place in seen) < 1e-5, names
        middle = np.append(inner.mean(axis=0)[:2], inner[:, 2].mean())
        gap = distance_m(found[f"wall-{wall}"], np.array([middle[0], middle[2], -middle[1]]))
        assert gap > 0.99 * min(b - a, high - low) / 2, "the wall is open there"


def distance_m(mesh: Any, place: np.ndarray) -> float:
    """From a place to the nearest point of a mesh."""
    near = trimesh.triangles.closest_point(mesh.triangles, np.repeat(place[None], len(mesh.triangles), axis=0))
    return float(np.linalg.norm(near - place, axis=1).min())
