"""Highlights: energy, Fresnel, the sun's glint, lamps, smooth edges and round shapes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from processing.errors import SceneError
from processing.light.picture import highlights
from processing.light.picture.composite import differential
from processing.light.picture.edges import NONE_MM, crossed_pixels, edge_pixels
from processing.light.picture.highlights import Surroundings, _sun_glint, facet_rays, is_glossy, mirrored_light
from processing.light.scene.scene import Material, Part, Scene, plain
from processing.light.scene.sources import find_lamps
from processing.light.solver.irradiance import Effort
from processing.light.solver.sight import FIRST_PART, sight_of
from processing.light.solver.stage import Stage, part_albedo
from processing.sphere import Equirectangular, directions
from tests.processing.light.rooms import EYE, box, box_room, scene_of, uniform_sky


def facets(facing: float, width: float, samples: int = 4096) -> tuple[np.ndarray, np.ndarray]:
    """Return mirrored rays and their weights for an eye whose ray meets a level surface at a cosine."""
    ray = np.array([[np.sqrt(1 - facing**2), 0, -facing]], np.float32)
    normal = np.array([[0, 0, 1]], np.float32)
    out, weight = np.empty((1, samples, 3), np.float32), np.empty((1, samples, 2), np.float32)
    facet_rays(ray, normal, np.array([[0.3, 0.6]]), samples, width, out, weight)
    return out[0], weight[0]


@pytest.mark.parametrize("facing", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("width", [0.02, 0.2, 0.5])
def test_a_white_mirror_gives_back_what_it_gets_and_no_more(facing: float, width: float) -> None:
    rays, weight = facets(facing, width)
    assert np.allclose(np.linalg.norm(rays[weight[:, 0] > 0], axis=1), 1, atol=1e-4)
    whole = float(weight[:, 0].mean())
    assert whole <= 1
    # What is lost is what facets shade of each other: nothing of a smooth surface, a third of a rough one at most.
    assert whole > (0.99 if width < 0.1 else 0.67)


def test_smooth_facets_mirror_and_rims_mirror_more() -> None:
    rays, weight = facets(0.6, 0.02)
    assert np.allclose(rays.mean(axis=0), [0.8, 0, 0.6], atol=0.01)
    assert facets(0.1, 0.02)[1][:, 1].mean() > 5 * weight[:, 1].mean()
    assert weight[:, 1].mean() == pytest.approx(0.4**5, rel=0.1)


def test_the_suns_glint_has_the_energy_of_the_facets() -> None:
    """Over all directions of the eye the glint gives what facets mirror of a ray: one lobe, both ways."""
    rng = np.random.default_rng(1)
    up = rng.uniform(0.01, 1, 200_000)
    around = rng.uniform(0, 2 * np.pi, len(up))
    level = np.sqrt(1 - up**2)
    eyes = -np.column_stack([level * np.cos(around), level * np.sin(around), up])
    normal = np.broadcast_to([0.0, 0.0, 1.0], eyes.shape)
    sight: Any = SimpleNamespace(rays=eyes, normal=normal)
    glint = _sun_glint(
        sight, np.arange(len(up)), np.ones((len(up), 3), np.float32), np.array([0.6, 0, 0.8]), 0.3, np.ones(3)
    )
    whole = 2 * np.pi * float((glint[:, 0] * up).mean())
    assert whole == pytest.approx(float(facets(0.8, 0.3)[1][:, 0].mean()), rel=0.04)


def test_which_materials_are_glossy() -> None:
    assert not is_glossy(Material("wool", (0.5, 0.5, 0.5), roughness=0.95))
    assert is_glossy(Material("lacquer", (0.5, 0.5, 0.5), roughness=0.3))
    assert is_glossy(Material("cast", (0.5, 0.5, 0.5), roughness=0.9, metallic=1.0))


def test_lamps_are_what_gives_more_light_than_it_gets() -> None:
    stage = Stage.of(scene_of(box_room(window=None), uniform_sky(0.0), 0.5))
    sight = sight_of(stage, Equirectangular(64, 32), EYE)
    n = len(sight.label)
    irradiance = np.full((n, 3), 300.0)
    rgb = np.full((n, 3), 0.5 * 300 / np.pi)
    shining = np.zeros(n, bool)
    shining[5 * 64 + 10 : 5 * 64 + 14] = shining[6 * 64 + 10 : 6 * 64 + 14] = True
    rgb[shining] = 5000.0
    emission, lamps = find_lamps(rgb, irradiance, np.full((n, 3), 0.5), sight, np.ones(n, bool))
    assert len(lamps) == 1
    assert lamps[0].luminance_cd_m2 == pytest.approx(5000 - 0.5 * 300 / np.pi, rel=1e-3)
    assert np.array_equal(emission.any(axis=1), shining)
    assert not find_lamps(rgb, irradiance, np.full((n, 3), 0.5), sight, ~shining)[1]


def test_a_lamp_on_the_seam_is_one() -> None:
    """Each half is smaller than what counts as a lamp, so that its light was lost."""
    stage = Stage.of(scene_of(box_room(window=None), uniform_sky(0.0), 0.5))
    sight = sight_of(stage, Equirectangular(1024, 512), EYE)
    rgb = np.full((len(sight.label), 3), 0.5 * 300 / np.pi)
    shining = np.zeros(sight.shape, bool)
    shining[240, [0, 1023]] = True
    rgb[shining.ravel()] = 5000.0
    light, usual = np.full(rgb.shape, 300.0), np.full(rgb.shape, 0.5)
    emission, lamps = find_lamps(rgb, light, usual, sight, np.ones(len(rgb), bool))
    assert len(lamps) == 1
    assert lamps[0].towards[1] == pytest.approx(-1, abs=0.02)
    assert np.array_equal(emission.any(axis=1), shining.ravel())


def test_lamps_light_the_room() -> None:
    from processing.light.solver.transport import light_map

    dark = scene_of(box_room(window=None), uniform_sky(0.0), 0.5)
    ceiling = replace(dark.surfaces[1], emission_cd_m2=plain(100.0))
    lit = Scene((dark.surfaces[0], ceiling, *dark.surfaces[2:]), (), dark.outdoors)
    assert light_map(Stage.of(dark, 0.5), 16).total.sum() == 0
    assert (light_map(Stage.of(lit, 0.5), 64).total[:4] > 100).all()


def ball(normals: bool) -> Part:
    """A coarse round column."""
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    low, high = (np.column_stack([0.4 * ring + (0, 1.2), np.full(12, z)]) for z in (0.2, 2.0))
    k = np.arange(12)
    following = (k + 1) % 12
    faces = np.concatenate(
        [np.column_stack([k, following, following + 12]), np.column_stack([k, following + 12, k + 12])]
    )
    outwards = np.column_stack([ring, np.zeros(12)]).astype(np.float32)
    return Part(
        "column",
        np.concatenate([low, high]),
        faces.astype(np.int32),
        Material("paint", (0.5, 0.5, 0.5)),
        normals=np.concatenate([outwards, outwards]) if normals else None,
    )


def test_round_shapes_look_round() -> None:
    def turns(part: Part) -> int:
        stage = Stage.of(scene_of(box_room(window=None), uniform_sky(0.0), 0.5).furnished((part,)))
        sight = sight_of(stage, Equirectangular(256, 128), EYE)
        row = sight.normal.reshape(128, 256, 3)[66][(sight.label == FIRST_PART).reshape(128, 256)[66]]
        return len(np.unique(row.round(3), axis=0))

    assert turns(ball(normals=False)) <= 7
    assert turns(ball(normals=True)) > 20


def test_normals_that_fit_no_vertices_are_refused() -> None:
    one = ball(normals=True)
    with pytest.raises(SceneError, match="normals"):
        replace(one, normals=one.normals[:3])


def test_a_parts_texture_is_smooth_between_texels_and_goes_on_where_it_repeats() -> None:
    corners = np.array([[0, 0, 0], [4, 0, 0], [4, 1, 0], [0, 1, 0]], float)
    stripes = np.array([[[0.2] * 3, [0.8] * 3]], np.float32)
    material = Material("stripes", (0.5, 0.5, 0.5), texture=stripes)
    rug = Part("rug", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material, uv=corners[:, :2])
    places = np.column_stack([[0.25, 0.5, 0.75, 1.0, 1.125, 2.25], np.full(6, 0.01), np.zeros(6)])
    found = part_albedo(rug, np.zeros(6, np.int32), places)[:, 0]
    np.testing.assert_allclose(found, np.multiply(material.colour[0], [0.2, 0.5, 0.8, 0.5, 0.35, 0.2]), rtol=1e-4)


def test_edges_are_where_furniture_ends() -> None:
    stage = Stage.of(scene_of(box_room(), uniform_sky(100.0), 0.5).furnished((box((0, 1.2, 0.5), (1, 1, 1)),)))
    sight = sight_of(stage, Equirectangular(128, 64), EYE)
    edge = edge_pixels(sight, crossed_pixels(stage, (64, 128), EYE))
    furniture = (sight.label >= FIRST_PART).reshape(64, 128)
    assert 0 < edge.sum() < 0.7 * furniture.sum()
    # Nothing of the room alone is an edge.
    near = furniture | np.roll(furniture, 1, 0) | np.roll(furniture, -1, 0)
    near |= np.roll(furniture, 1, 1) | np.roll(furniture, -1, 1)
    assert not edge[~near].any()


def test_what_is_thinner_than_a_pixel_is_drawn_throughout() -> None:
    """Nothing of a rod is seen by any pixel's middle: it was not there, and askew it was in dashes."""
    effort = Effort(texel_m=0.5, patch_samples=16, rows=32, pixel_samples=16, sun_samples=16, clean=False)
    room = scene_of(box_room(window=None), uniform_sky(0.0), 0.5)
    room = replace(
        room, surfaces=(room.surfaces[0], replace(room.surfaces[1], emission_cd_m2=plain(100.0)), *room.surfaces[2:])
    )
    photograph = np.full((128, 256, 3), 100.0, np.float32)
    rod = box((0.0, 1.5, 1.5), (0.012, 0.012, 1.0), (0.02, 0.02, 0.02))  # half a pixel wide, between two columns
    sight = sight_of(Stage.of(room.furnished((rod,))), Equirectangular(256, 128), EYE)
    assert not (sight.label >= FIRST_PART).any()
    staged = differential(photograph, room, (rod,), EYE, effort=effort).rgb[..., 0]
    beside, seen = staged[54:74, 120:124].mean(axis=1), staged[54:74, 127:129].mean(axis=1)
    assert (seen < 0.9 * beside).all()
    assert np.ptp(seen) < 4, "as dark all along"


def test_edges_of_a_mesh_are_its_rims_and_creases_whatever_its_corners_are_shared_by() -> None:
    shape, part = (256, 512), box((0, 1.5, 1.4), (1, 1, 1))
    room = scene_of(box_room(window=None), uniform_sky(0.0), 0.5)
    whole, apart = (
        crossed_pixels(Stage.of(room.furnished((one,))), shape, EYE)
        for one in (
            part,
            replace(
                part,
                vertices_m=part.vertices_m[part.faces].reshape(-1, 3),
                faces=np.arange(36, dtype=np.int32).reshape(-1, 3),
            ),
        )
    )
    assert np.array_equal(whole, apart)
    sight = sight_of(Stage.of(room.furnished((part,))), Equirectangular(512, 256), EYE)
    front = (sight.normal[:, 1] < -0.99).reshape(shape) & (sight.label == FIRST_PART).reshape(shape)
    columns = np.flatnonzero(front.any(axis=0))[3:-3]
    for column in columns:
        rows = np.flatnonzero(front[:, column])
        assert (whole[rows[3:-3], column] == NONE_MM).all(), "the seam of two triangles in one plane is no edge"
        assert all((whole[end - 1 : end + 2, column] < NONE_MM).any() for end in rows[[0, -1]])
    assert int(whole.min()) == pytest.approx(1000 * np.hypot(1, 0.3), abs=3)


def test_single_pixels_of_one_face_mirror_alike() -> None:
    """Each by rays of its own made beads of a rod of brass."""
    room = scene_of(box_room(), uniform_sky(1000.0), 0.5)
    stage = Stage.of(room.furnished((box((0, 1.5, 1.4), (1, 0.02, 1), (1, 1, 1), metallic=1.0, roughness=0.3),)), 0.5)
    sight = sight_of(stage, Equirectangular(64, 32), EYE)
    pixel = int(np.flatnonzero(sight.label == FIRST_PART)[0])
    from processing.light.solver.transport import light_map

    seen = sight.some(np.full(40, pixel))
    around = Surroundings(
        stage, light_map(stage, 16), np.full((32, 64, 3), 50, np.float32), sight, np.ones((stage.patches.count, 3)), EYE
    )
    alike, apart = (mirrored_light(around, seen, np.arange(40), 0.1, np.ones(3), 12, key)[0] for key in ((), (0, 1)))
    assert np.ptp(alike[:, 0]) == 0
    assert np.ptp(apart[:, 0]) > 0
    assert alike[0, 0] == pytest.approx(apart[:, 0].mean(), rel=0.2)


@pytest.mark.parametrize("window", [None, (1.5, 3.5, 0.8, 2.3)])
def test_a_looking_glass_shows_the_room_as_an_image(monkeypatch: pytest.MonkeyPatch, window: Any) -> None:
    """Stripes of the photograph, found where a plane mirror shows them: plain geometry, not the tracer's."""
    monkeypatch.setattr(highlights, "MOST_ROWS", 96)  # the small picture, in which the stripes are lost
    effort = Effort(texel_m=0.5, patch_samples=16, rows=32, pixel_samples=16, sun_samples=16, clean=False)
    rows, half = 320, np.array([2.5, 2.0])

    def stripes(rays: np.ndarray) -> np.ndarray:
        return np.where(np.sin(36 * np.arctan2(rays[..., 0], rays[..., 1])) > 0, 150.0, 50.0)

    rays = np.asarray(directions(Equirectangular(2 * rows, rows))[0], np.float64)
    photograph = np.repeat(stripes(rays)[..., None], 3, axis=-1).astype(np.float32)
    glass = box((0.0, 1.96, 1.3), (1.6, 0.02, 1.2), (1.0, 1.0, 1.0), metallic=1.0, roughness=0.04)
    room = scene_of(box_room(window=window), uniform_sky(1000.0), 0.5)
    staged = differential(photograph, room, (glass,), EYE, effort=effort).rgb[..., 0]

    front = rays * (1.95 / np.maximum(rays[..., 1:2], 1e-9))  # from the eye, on the glass's front
    inside = (rays[..., 1] > 0) & (abs(front[..., 0]) < 0.75) & (abs(front[..., 2]) < 0.2)
    start, way = front[inside], rays[inside] * (1, -1, 1)
    ends = np.stack([(np.sign(way[:, k]) * half[k] - start[:, k]) / way[:, k] for k in (0, 1)])
    heights = np.where(way[:, 2] > 0, 1.1, -1.6) - start[:, 2]
    place = start + np.minimum(ends.min(axis=0), heights / way[:, 2])[:, None] * way
    expected = stripes(place)
    assert inside.sum() > 300
    assert np.corrcoef(staged[inside], expected)[0, 1] > 0.9
    shown = [float(np.median(staged[inside][expected == level])) for level in (50, 150)]
    assert shown[1] / shown[0] == pytest.approx(3, rel=0.1)
