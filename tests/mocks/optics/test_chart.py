"""The chart room: is its light what it says, and do both cameras see the same chart the right way round?"""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from mocks.optics.camera import CANON_5D2, THETA_Z1, image_rows
from mocks.optics.chart import PATCHES, WHITE, ChartRoom, patch_albedos
from mocks.worlds.light import LightDrift, Site, luminance_cd_m2
from mocks.worlds.world import meter_luminance_cd_m2, open_world

SITES = {Site.INDOOR: THETA_Z1, Site.OUTDOOR: CANON_5D2}


def test_patches_have_the_published_reflectances():
    """Neutral patches against the densities of the Macbeth chart (0.05, 0.23, 0.44, 0.70, 1.05, 1.50), to 10 %."""
    albedo = patch_albedos()
    greys = luminance_cd_m2(albedo[WHITE:])
    np.testing.assert_allclose(greys, 10.0 ** -np.array([0.05, 0.23, 0.44, 0.70, 1.05, 1.50]), rtol=0.1)
    assert albedo.min() > 0
    assert len({name for name, _ in PATCHES}) == len(PATCHES) == 24
    names = [name for name, _ in PATCHES]
    for name, channel in (("red", 0), ("green", 1), ("blue", 2)):
        assert albedo[names.index(name)].argmax() == channel


def test_white_patch_is_lit_as_the_formula_says():
    """A lamp of 60 000 cd/m2 and 0.6 x 0.6 m on the ceiling 1 m up and 0.4 m back, and the bounces of the box."""
    room = ChartRoom()
    x, z = -2.5 * 0.11, -1.5 * 0.11
    r2 = x**2 + 1.4**2 + (1.0 - z) ** 2
    direct_lx = 60_000 * 0.36 * ((1.0 - z) / math.sqrt(r2)) * (1.4 / math.sqrt(r2)) / r2
    wall, floor, ceiling = (
        np.dot(rgb, (0.2127, 0.7151, 0.0722)) for rgb in ((0.62, 0.60, 0.56), (0.26, 0.22, 0.18), (0.80, 0.80, 0.79))
    )
    area = 2 * (4 * 3.8 + 4 * 2.6 + 3.8 * 2.6)
    mean = (wall * 2 * (4 * 2.6 + 3.8 * 2.6) + (floor + ceiling) * 4 * 3.8) / area
    bounced_lx = math.pi * 60_000 * 0.36 * mean / (1 - mean) / area
    white = float(luminance_cd_m2(patch_albedos()[WHITE] * lamp_rgb(room)))
    assert room.patch_luminances_cd_m2[WHITE] == pytest.approx(white * (direct_lx + bounced_lx) / math.pi, rel=1e-4)
    assert 300 < room.patch_luminances_cd_m2[WHITE] < 3000


def lamp_rgb(room):
    """The lamp's colour, seen in the lamp itself (luminance 1)."""
    lamp = room.radiance(Site.INDOOR, np.array([[0.0, -0.371, 0.928]], dtype=np.float32))[0]
    assert luminance_cd_m2(lamp) == pytest.approx(room.lamp_cd_m2, rel=1e-4)
    return lamp / room.lamp_cd_m2


def test_lamps_go_from_warm_to_neutral():
    ratios = {room.lamp_kelvin: lamp_rgb(room)[2] / lamp_rgb(room)[0] for room in map(ChartRoom, range(5))}
    assert ratios[2700] < ratios[3000] < ratios[4000] < ratios[5000] < ratios[6500]
    assert ratios[6500] == pytest.approx(1.0, abs=0.08)
    assert ChartRoom(1).key != ChartRoom(2).key


@pytest.mark.parametrize("site", SITES)
def test_each_camera_has_the_chart_upright_before_its_axis(site):
    """Dark skin top left, bluish green top right, white bottom left: as printed, not mirrored."""
    optics, room = SITES[site], ChartRoom()
    size = optics.full_size
    places = np.array([optics.lens.pixel_of(tuple(d), size) for d in room.patch_directions(site)])
    middle = np.array(size) / 2
    np.testing.assert_allclose(places.mean(axis=0), middle, atol=1)
    assert places[0, 0] < places[5, 0]
    assert places[0, 1] < places[18, 1]
    assert places[WHITE, 0] < middle[0] < places[23, 0]
    assert np.abs(places - middle).max() < 0.12 * size[0]


@pytest.mark.parametrize("site", SITES)
def test_pictures_hold_the_luminance_of_every_patch(site):
    """The image of a camera without fall-off and filter has each patch's known luminance in the patch's middle."""
    optics, room = SITES[site], ChartRoom(seed=2)
    size = (480, 240) if site is Site.INDOOR else (396, 264)
    image = luminance_cd_m2(
        image_rows(
            room,
            replace(optics, lens=replace(optics.lens, vignetting=()), filter=type(optics.filter)()),
            size,
            range(size[1]),
        )
    )
    assert len(room.patch_luminances_cd_m2) == len(PATCHES) == 24
    for direction, expected in zip(room.patch_directions(site), room.patch_luminances_cd_m2, strict=True):
        x, y = optics.lens.pixel_of(tuple(direction), size)
        assert image[int(y), int(x)] == pytest.approx(expected, rel=0.01)


def test_both_sites_see_the_same_luminances():
    room = ChartRoom()
    assert len(room.patch_luminances_cd_m2) == len(PATCHES) == 24
    for site in Site:
        seen = luminance_cd_m2(room.radiance(site, room.patch_directions(site)))
        np.testing.assert_allclose(seen, room.patch_luminances_cd_m2, rtol=1e-5)


def test_meter_reads_the_white_patch():
    room = ChartRoom(drift=LightDrift(0.1, seed=3))
    read = meter_luminance_cd_m2(room, room.board_direction, 40.0)
    white = float(room.patch_luminances_cd_m2[WHITE])
    assert read == pytest.approx(white * room.drift.factor(40.0), rel=2e-3)
    assert read != pytest.approx(white, rel=1e-3)


def test_room_is_closed_and_plausible():
    """No direction without light, no sky, and brighter ahead near the lamp than in the corners of the floor."""
    room = ChartRoom()
    directions = np.random.default_rng(1).normal(size=(4000, 3))
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    light = luminance_cd_m2(room.radiance(Site.INDOOR, directions))
    assert np.isfinite(light).all()
    assert light.min() > 5
    assert room.open_sky(Site.INDOOR, directions).max() == 0
    assert room.discs(Site.OUTDOOR) == ()
    axes = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    assert np.isfinite(room.radiance(Site.INDOOR, axes)).all()


def test_chart_has_a_name_and_survives_the_way_to_a_worker():
    assert open_world("chart") == ChartRoom(0)
    room = open_world("chart:3")
    assert room == ChartRoom(3)
    copy = pickle.loads(pickle.dumps(room))
    np.testing.assert_array_equal(copy.patch_luminances_cd_m2, room.patch_luminances_cd_m2)
