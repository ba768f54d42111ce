"""The display: white is white, the view outside is kept, and nothing else than what was asked is changed."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from processing.errors import ParameterError
from processing.ground.colour import lab_of_linear, linear_of_srgb, luminance_cd_m2, srgb_encoded
from processing.pictures import display
from processing.pictures.display import (
    AS_GIVEN,
    BRIGHT_LEVEL,
    DAYLIGHT_SHARE,
    KNEE,
    LEAST_VIEW,
    PLATEAU,
    TOE,
    TOE_END,
    Display,
    developed,
    display_of,
    film,
    screen,
    spot_colour,
)
from processing.pictures.whites import CALM, CALM_SPREAD

WARM = np.array([1.3, 1.0, 0.55])
SHAPE = (64, 128)


def room() -> tuple[np.ndarray, np.ndarray]:
    """A grey room of 100 cd/m2 under warm light with a window of 100 times that; and where the window is."""
    rng = np.random.default_rng(4)
    level = 100 * rng.uniform(0.6, 1.0, SHAPE)
    panes = np.zeros(SHAPE, bool)
    panes[20:34, 50:80] = True
    level[panes] *= np.where(np.arange(30) < 15, 40, 100)[None].repeat(14, axis=0).ravel()
    return (level[..., None] * WARM).astype(np.float32), panes


def test_the_board_is_white_whatever_the_light_and_luminance_follows_the_exposure() -> None:
    rgb, panes = room()
    board = spot_colour(rgb, 0.5, -0.4)
    display = display_of(rgb, board_rgb=board, panes=panes)
    assert display.source == "board and ceiling"
    shown = linear_of_srgb(display.shown(rgb, panes))[~panes].astype(float)
    lab = lab_of_linear(shown, np.ones(3))
    assert np.abs(lab[:, 1:]).max() < 1.0
    assert display.white == pytest.approx(WARM / (WARM @ [0.2127, 0.7151, 0.0722]), rel=1e-4)
    light = display.light(WARM[None, None].astype(np.float32) * 50)
    assert light[0, 0] == pytest.approx(np.full(3, 50 * display.exposure * (WARM @ [0.2127, 0.7151, 0.0722])), rel=1e-3)


def test_white_is_mostly_the_ceilings_where_it_can_be_white_and_the_boards_under_a_wooden_one() -> None:
    rgb, panes = room()
    yellow, wood = rgb.copy(), rgb.copy()
    yellow[:16] *= np.float32([1.0, 1.0, 0.75])
    wood[:16] *= np.float32([1.3, 1.0, 0.4])
    result = display_of(yellow, board_rgb=WARM, panes=panes)
    lab = lab_of_linear(linear_of_srgb(result.shown(yellow, panes))[:14].reshape(-1, 3).astype(float), np.ones(3))
    assert result.source == "board and ceiling"
    assert np.abs(lab[:, 1:]).max() < 4
    assert "ceiling" in result.said
    under = display_of(wood, board_rgb=WARM, panes=panes)
    assert under.source == "board"
    assert under.white == pytest.approx(WARM / (WARM @ [0.2127, 0.7151, 0.0722]), rel=1e-4)


def test_bradford_is_what_colour_science_has() -> None:
    import colour

    from processing.ground.colour import RGB_OF_XYZ, XYZ_OF_RGB

    display = display_of(room()[0], board_rgb=WARM)
    xyz = np.asarray(XYZ_OF_RGB)
    white = xyz @ display.white
    theirs = colour.adaptation.matrix_chromatic_adaptation_VonKries(white, xyz @ np.ones(3), transform="Bradford")
    ours = np.reshape(display.matrix, (3, 3)) / display.exposure
    np.testing.assert_allclose(ours, np.asarray(RGB_OF_XYZ) @ theirs @ xyz, atol=2e-3)


def test_the_view_is_kept_and_the_room_stays() -> None:
    rgb, panes = room()
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    pulled, plain = display.light(rgb, panes), display.balanced(rgb)
    assert display.pull < 0.05
    np.testing.assert_array_equal(pulled[:14], display.light(rgb)[:14])
    inside = pulled[22:32, 52:78]
    assert inside.max() < 1.5 < 20 < plain[panes].max()
    ratio = float(pulled[22:32, 67:78].mean() / pulled[22:32, 52:63].mean())
    assert 1.5 < ratio < 2.7  # 2.5 in truth: the view's own contrast is not flattened away
    assert (screen(inside) < 254).all()


def test_a_bright_edge_has_no_stairs_and_all_else_stays() -> None:
    """Coverage of a slanted edge, exact: its film showed the bright side of each pixel alone."""
    x, y = np.meshgrid(np.arange(120), np.arange(60))
    share = np.clip(x - 40 - y / 7, 0, 1).astype(np.float32)
    light = np.repeat((0.1 + 6 * share)[..., None], 3, axis=2)
    plain, even = screen(light).astype(float)[..., 0], developed(light).astype(float)[..., 0]
    steps = [np.abs(np.diff(one, axis=1)).max() for one in (plain, even)]
    assert steps[1] < 0.6 * steps[0]
    away = np.abs(x - 40 - y / 7) > 3
    np.testing.assert_array_equal(even[away], plain[away])
    dim = np.random.default_rng(0).uniform(0, 0.4, (50, 60, 3)).astype(np.float32)
    np.testing.assert_array_equal(developed(dim), screen(dim))


def test_white_in_the_skys_light_is_white_where_a_blue_sky_is_seen_and_blue_cloth_stays_blue() -> None:
    """Sky of 12,000 K against the room's white, by CIE D12000 in linear Rec. 709."""
    rgb, panes = room()
    sky = np.array([0.78, 1.0, 1.62])
    rgb[panes] *= sky.astype(np.float32)
    lit = (3 * sky + 1) / 4
    rgb[30:34, 50:80] = 40 * WARM * (3 * sky + 1) / 4  # of it a road, no brighter than the room
    rgb[40:50, :60], rgb[40:50, 60:] = 60 * WARM * lit, 30 * WARM * lit * [0.25, 0.45, 1.0]
    found = display_of(rgb, board_rgb=WARM, panes=panes)
    assert found.sky is not None
    assert found.sky == pytest.approx(tuple(sky / luminance_cd_m2(sky)), rel=0.05)  # Bradford
    before, after = (one.light(rgb, panes) for one in (replace(found, sky=None), found))
    white, blue = (np.s_[44, k] for k in (20, 100))
    off = [lab_of_linear(one[white][None].astype(float), np.ones(3))[0, 2] for one in (before, after)]
    assert off[0] < -12
    assert abs(off[1]) < 0.5 * abs(off[0])
    np.testing.assert_allclose(after[blue], before[blue], rtol=0.02)
    np.testing.assert_allclose(luminance_cd_m2(after[white]), luminance_cd_m2(before[white]), rtol=1e-3)
    np.testing.assert_array_equal(after[panes], before[panes])  # the view
    assert Display.read(json.loads(json.dumps(found.to_dict()))) == found
    grey, seen = room()
    assert display_of(grey, board_rgb=WARM, panes=seen).sky is None


def test_the_view_is_nearer_to_the_cameras_own_white_than_the_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("processing.pictures.display.CALM", 0.0)  # of the pull alone
    monkeypatch.setattr("processing.pictures.display.HIGHLIGHT_STOPS", 1e9)
    monkeypatch.setattr("processing.pictures.display.VIEW_LEVEL", 0.9)  # a pull that all channels of a reveal reach
    rgb, panes = room()
    rgb[panes] = rgb[panes].mean(axis=1, keepdims=True)  # grey by daylight, which the room's white turns blue
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    pulled, plain = display.light(rgb, panes)[27, 70], display.balanced(rgb)[27, 70]
    before, after = (float(one[2] / one[0]) for one in (plain, pulled))
    assert 1 < after < before
    assert after == pytest.approx(before ** (1 - DAYLIGHT_SHARE), rel=0.02)
    # A reveal keeps the room's white, and is lowered by half as many stops.
    rim = display.light(rgb, panes.astype(np.uint8))[27, 70]
    np.testing.assert_allclose(rim / rim[1], plain / plain[1], rtol=1e-4)
    stops = [math.log2(luminance_cd_m2(one) / luminance_cd_m2(plain)) for one in (rim, pulled)]
    assert stops[0] == pytest.approx(stops[1] / 2, abs=0.05)
    # What the film shows in proportion stays as it is, and nothing brighter becomes darker than that.
    steps = np.geomspace(0.1, 50, 200, dtype=np.float32)
    ramp = np.repeat(np.tile(steps, (64, 1))[..., None], 3, axis=2)
    shown = replace(AS_GIVEN, pull=0.05).light(ramp, np.ones(ramp.shape[:2], np.uint8), around=False)[32, :, 0]
    assert (np.diff(shown) > -1e-3).all()
    np.testing.assert_allclose(shown[steps < KNEE], steps[steps < KNEE], rtol=1e-3)
    np.testing.assert_array_equal(display.light(rgb, 2 * panes.astype(np.uint8)), display.light(rgb, panes))


def test_a_frame_lit_by_sky_and_lawn_is_white_and_sharp_beside_the_view() -> None:
    """It was milky and green: half a view in a zone as wide as itself, and as coloured as what lights it."""
    rgb, level = np.full((512, 1024, 3), 60.0, np.float32), np.ones((512, 1024), np.float32)
    panes = np.zeros((512, 1024), np.uint8)
    panes[180:300, 400:600], panes[192:288, 412:588] = 1, 2
    rng = np.random.default_rng(7)
    view = np.float32([0.45, 1.0, 0.35]) * rng.uniform(800, 2500, (96, 176, 1)).astype(np.float32)
    rgb[panes == 1] = np.float32([1.0, 1.15, 1.3]) * 220
    rgb[panes == 2] = view.reshape(-1, 3)
    display = replace(display_of(rgb, board_rgb=np.ones(3), panes=panes), matrix=AS_GIVEN.matrix)
    display = replace(display, matrix=tuple((0.57 / 60 * np.eye(3)).ravel()))
    assert display.pull < 0.2
    light = display.light(rgb, panes)
    # A bar of 12 pixels, 4 degrees wide, is a frame but for the pixels at its edge.
    frame = np.zeros(level.shape, bool)
    frame[184:296, 403:409] = True
    lowered = luminance_cd_m2(light)[frame] / luminance_cd_m2(display.balanced(rgb))[frame]
    assert np.ptp(lowered) < 0.03
    assert 0.3 < lowered.mean() < 0.7
    assert luminance_cd_m2(light)[frame].min() > KNEE
    shown = lab_of_linear(linear_of_srgb(screen(light))[frame].astype(float), np.ones(3))
    plain = lab_of_linear(linear_of_srgb(screen(0.5 * display.light(rgb)))[frame].astype(float), np.ones(3))
    chroma = [float(np.hypot(lab[:, 1], lab[:, 2]).mean()) for lab in (shown, plain)]
    assert chroma[0] < 0.5 * chroma[1]


def test_a_bar_as_bright_and_green_as_the_view_is_a_frame_and_a_strip_of_sky_is_view() -> None:
    rgb, panes = np.full((512, 1024, 3), 60.0, np.float32), np.zeros((512, 1024), np.uint8)
    panes[180:300, 400:600], panes[192:288, 412:588] = 1, 2
    trees = np.random.default_rng(7).uniform(300, 2500, (96, 176, 1)).astype(np.float32) * np.float32([0.45, 1, 0.35])
    rgb[panes == 1], rgb[panes == 2] = np.float32([1.0, 1.15, 1.3]) * 220, trees.reshape(-1, 3)
    rgb[192:288, 520:588] = np.float32([500, 800, 1500])  # a sky, in which nothing is set off
    rgb[232:288:2, 524:588:6] *= 0.5  # but posts, which part it into narrow strips
    rgb[192:288, 460:465] = np.float32([150, 300, 200]) * np.linspace(1, 2, 96, dtype=np.float32)[:, None, None]
    display = replace(display_of(rgb, board_rgb=np.ones(3), panes=panes), matrix=tuple((0.57 / 60 * np.eye(3)).ravel()))
    lowered = luminance_cd_m2(display.light(rgb, panes)) / luminance_cd_m2(display.light(rgb))
    assert lowered[200:280, 462].min() > 0.5, "by half of what it is too bright at most"
    assert np.ptp(lowered[196:230, 526:584]) < 0.02, "no stripes"
    assert lowered[196:230, 526:584].max() < 0.5


def test_a_strip_of_the_view_beside_a_pane_that_was_estimated_too_narrow_is_view_and_wall_is_none() -> None:
    rgb, panes = np.full((512, 1024, 3), 60.0, np.float32), np.zeros((512, 1024), np.uint8)
    rgb[192:288, 412:600] = np.random.default_rng(7).uniform(900, 1100, (96, 188, 1)).astype(np.float32)
    panes[180:300, 400:600], panes[192:288, 412:588] = 1, 2
    display = replace(display_of(rgb, board_rgb=np.ones(3), panes=panes), matrix=tuple((0.57 / 60 * np.eye(3)).ravel()))
    lowered = luminance_cd_m2(display.light(rgb, panes)) / luminance_cd_m2(display.light(rgb))
    assert np.ptp(lowered[200:280, 430:594]) < 0.1
    np.testing.assert_allclose(lowered[200:280, 606:640], 1, rtol=0.01)
    far = np.where(np.arange(1024) > 640, 0, panes).astype(np.uint8)
    far[192:288, 540:] = 0  # too narrow by more than openings ever are
    assert display.light(rgb, far)[240, 580] == pytest.approx(display.light(rgb, np.minimum(far, 1))[240, 580])


def test_what_is_nearly_white_is_shown_whiter_and_strong_colours_stay() -> None:
    def spread(rgb: tuple[float, float, float], scale: float = 0.4) -> tuple[float, float]:
        given = scale * np.float32([[rgb]])
        found = AS_GIVEN.light(given)
        assert luminance_cd_m2(found) == pytest.approx(luminance_cd_m2(given), rel=1e-5)
        return float(np.ptp(found) / np.ptp(given)), float(np.ptp(given) / luminance_cd_m2(given)[0, 0])

    for rgb in ((1.0, 0.97, 1.02), (1.04, 1.0, 0.98)):
        assert spread(rgb)[0] == pytest.approx(1 - CALM, abs=0.02)
        assert spread(rgb, 0.01) == pytest.approx(spread(rgb), rel=1e-3)
    assert spread((1.0, 0.5, 0.2))[0] > 0.99
    left, apart = spread((1 + CALM_SPREAD * 0.95, 1.0, 1.0))
    assert apart == pytest.approx(CALM_SPREAD, rel=0.1)
    assert left == pytest.approx(1 - CALM / 2, abs=0.08)
    assert (AS_GIVEN.light(np.zeros((2, 2, 3), np.float32)) == 0).all()


def test_texture_in_the_sun_is_shown_and_what_is_no_highlight_stays() -> None:
    """A rug in the sun, 8 to 12 times as bright as the room's walls, was white without form."""
    rng = np.random.default_rng(3)
    level = 0.3 * rng.uniform(0.9, 1.1, (256, 512)).astype(np.float32)
    level[100:160, 0:300] *= 32
    rgb = np.repeat(level[..., None], 3, axis=2)
    shown, film_alone = AS_GIVEN.shown(rgb)[..., 0].astype(int), screen(rgb)[..., 0].astype(int)
    sunny = np.zeros(level.shape, bool)
    sunny[110:150, 10:290] = True
    assert film_alone[sunny].min() > 248
    assert 225 < np.median(shown[sunny]) < 240
    assert np.std(film(AS_GIVEN.light(rgb))[sunny]) > 6 * np.std(film(rgb)[sunny])
    # Of details the contrast is kept; what is darker than the film's white is shown as it was, at the very edge too.
    light = np.log2(AS_GIVEN.light(rgb)[..., 0])[sunny]
    assert np.std(light) == pytest.approx(np.std(np.log2(level[sunny])), rel=0.25)
    np.testing.assert_array_equal(shown[level < 1], film_alone[level < 1])
    seam = AS_GIVEN.light(np.roll(rgb, 256, axis=1))
    np.testing.assert_allclose(np.roll(seam, -256, axis=1), AS_GIVEN.light(rgb), rtol=1e-3)


def test_trees_in_the_shade_are_part_of_the_view() -> None:
    """Dark leaves would keep the room's white, turquoise, within an edge of their own."""
    rgb, panes = room()
    leaves = np.array([20.0, 45.0, 16.0], np.float32)
    rgb[24:30, 68:76] = leaves
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    pulled, plain = display.light(rgb, panes)[27, 72], display.light(rgb)[27, 72]
    assert plain[1] < LEAST_VIEW  # no brighter than the room's walls
    given, room_white, view_white = (float(one[2] / one[1]) for one in (leaves, plain, pulled))
    assert given < view_white < math.sqrt(given * room_white)
    assert PLATEAU * 0.8 < pulled[1] < plain[1]


def test_shade_amid_a_view_is_part_of_it_and_a_bar_is_not() -> None:
    """A house's dark windows were pale holes in the view, as if they stood in the room."""
    rgb, panes = room()
    rgb[25:29, 70:74], rgb[20:34, 60:65] = 80 * WARM, 80 * WARM
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    pulled, plain = (luminance_cd_m2(one) for one in (display.light(rgb, panes), display.balanced(rgb)))
    assert LEAST_VIEW > plain[27, 72] > PLATEAU
    assert pulled[27, 72] < 0.8 * plain[27, 72]
    assert pulled[27, 62] == pytest.approx(plain[27, 62], rel=0.1)


def test_what_stands_before_a_pane_or_was_taken_for_one_stays() -> None:
    rgb, panes = room()
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    wide = panes.copy()
    wide[20:34, 85:100] = True
    rgb[20:34, 60:66] = 30 * WARM
    pulled, plain = display.light(rgb, wide), display.light(rgb)
    np.testing.assert_allclose(pulled[24:30, 88:97], plain[24:30, 88:97], rtol=0.05)
    np.testing.assert_allclose(pulled[24:30, 62:64], plain[24:30, 62:64], rtol=0.25)


def test_white_is_from_the_board_else_the_windows_else_surfaces_and_said() -> None:
    rgb, panes = room()
    assert display_of(rgb, panes=panes).source == "windows and ceiling"
    assert display_of(rgb).source == "surfaces and ceiling"
    assert display_of(rgb, board_rgb=np.array([9.0, 1.0, 0.1]), panes=panes).source == "windows and ceiling"
    given = display_of(rgb, board_rgb=WARM, balanced=True)
    assert given.source == "given"
    assert given.white == pytest.approx(np.ones(3))
    said = [display_of(rgb, board_rgb=WARM).said, display_of(rgb).said, given.said]
    assert len(set(said)) == 3
    black = display_of(np.zeros((8, 16, 3), np.float32))
    assert (black.shown(np.zeros((8, 16, 3), np.float32)) == 0).all()


def test_one_display_for_all_states_and_as_a_file() -> None:
    rgb, panes = room()
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    assert Display.read(json.loads(json.dumps(display.to_dict()))) == display
    for light, where in ((display.balanced, np.ones_like(panes)), (display.light, np.indices(SHAPE)[0] > 40)):
        np.testing.assert_allclose(light(rgb * 0.5)[where], light(rgb)[where] * 0.5, rtol=1e-5)
    for bad in ({}, {"matrix": [1.0] * 8, "pull": 1.0, "source": "x"}, {"matrix": [1.0] * 9, "pull": 0, "source": "x"}):
        with pytest.raises(ParameterError):
            Display.read(bad)


def test_another_hour_has_its_own_exposure_and_the_same_white() -> None:
    rgb, _ = room()
    display = display_of(rgb, board_rgb=WARM)
    dusk = display.exposed(rgb * 0.01)
    assert dusk.exposure == pytest.approx(100 * display.exposure, rel=0.02)
    np.testing.assert_allclose(dusk.white, display.white)
    level = AS_GIVEN.exposed(rgb).light(rgb) @ np.array([0.2127, 0.7151, 0.0722], np.float32)
    assert np.quantile(level, 0.75) == pytest.approx(BRIGHT_LEVEL, rel=0.03)


def test_film_deepens_shadows_keeps_middle_tones_and_never_clips() -> None:
    light = np.geomspace(1e-3, 1e3, 400).astype(np.float32)
    shown = film(light)
    assert (np.diff(shown) > 0).all()
    assert shown[0] == pytest.approx((1 - TOE) * 1e-3, rel=1e-3)
    assert film(np.float32([TOE_END]))[0] == pytest.approx((1 - TOE / 2) * TOE_END, rel=1e-5)
    middle = (light > 0.4) & (light <= KNEE)
    np.testing.assert_allclose(shown[middle], light[middle], rtol=0.04)
    assert shown.max() < 1
    exact = np.rint(255 * srgb_encoded(shown.astype(np.float64)))
    off = np.abs(screen(light) - exact)
    assert off.max() <= 1
    assert np.count_nonzero(off) <= 4
    ends = np.float32([np.nan, np.inf, 3e38, 0, -0.0, -1, -np.inf])
    np.testing.assert_array_equal(screen(ends), [0, 255, 255, 0, 0, 0, 0])
    slopes = np.diff(film(np.arange(0.5, 0.7, 0.01, dtype=np.float32))) / 0.01
    assert slopes[0] == pytest.approx(1, abs=0.03)
    assert np.abs(np.diff(slopes)).max() < 0.06, "no kink at the knee"


def test_the_mask_goes_on_beyond_the_seam() -> None:
    rgb, panes = room()
    display = display_of(rgb, board_rgb=WARM, panes=panes)
    middle = display.light(rgb, panes)
    turned = display.light(np.roll(rgb, 64, axis=1), np.roll(panes, 64, axis=1))
    np.testing.assert_allclose(np.roll(turned, -64, axis=1), middle, rtol=2e-3, atol=1e-4)
    assert math.isfinite(float(turned.sum()))


@pytest.mark.parametrize("reach", [3, 9])
@pytest.mark.parametrize("around", [True, False])
def test_what_is_far_from_highlights_is_left_out_and_changes_nothing(
    reach: int, around: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same as if all of the picture were filtered at once, in bands of any height and across the seam."""
    light = np.random.default_rng(1).uniform(0.05, 0.9, (300, 600)).astype(np.float32)
    for row, column in ((20, 3), (150, 300), (160, 310), (290, 597)):
        light[row : row + 9, np.arange(column, column + 9) % 600] = 30.0
    monkeypatch.setattr(display, "_FILTERED_ROWS", 64)
    found = display._guided(light, None, reach, 0.2, around=around)
    assert (found == 0).mean() > 0.3
    monkeypatch.setattr(display, "_FILTERED_ROWS", 1 << 20)
    stops = np.log2(np.concatenate([light] * 3, axis=1) if around else light)
    scale = 0.5 if reach >= display.HALVED_PX else 1.0
    whole = cv2.ximgproc.guidedFilter(stops, stops, reach, 0.2, scale=scale)
    whole = whole[:, 600:1200] if around else whole
    inner = np.s_[:, :] if around else np.s_[:, 60:-60]
    np.testing.assert_allclose(np.maximum(found, 0)[inner], np.maximum(whole, 0)[inner], atol=2e-4)
