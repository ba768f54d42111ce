"""The real bracket of a Canon 5D Mark II with an 8 mm fisheye: our whole chain beside the map published with it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.photometry import canon_real as canon
from processing.calibration.outdoor import lens
from processing.calibration.outdoor.lens import find_image_circle
from processing.calibration.scale.photometry import illuminance_lx
from processing.pictures.frames import jpeg_frame
from processing.pictures.images import LuminanceImage

pytestmark = pytest.mark.shared("brackets/canon5d2_8mm_bracket")


@pytest.fixture(scope="module")
def bracket() -> canon.CanonBracket:
    return canon.read_bracket(8)


@pytest.fixture(scope="module")
def ours(bracket: canon.CanonBracket) -> LuminanceImage:
    image, _ = canon.own_image(bracket)
    return canon.luminance_map(image, canon.REFERENCE_CIRCLE.scaled(bracket.size_px), 260)


def test_illuminance_within_three_per_cent(ours: LuminanceImage) -> None:
    assert illuminance_lx(ours).value_lx == pytest.approx(canon.PUBLISHED_LUX, rel=0.03)


def test_the_reference_map_gives_its_own_illuminance() -> None:
    assert canon._summed_lx(canon.reference_map()) == pytest.approx(canon.PUBLISHED_LUX, rel=2e-4)


def test_evalglare_finds_our_illuminance(ours: LuminanceImage) -> None:
    pytest.importorskip("pyradiance", reason="an oracle of the bench extra")
    assert canon.evalglare_lx(ours) == pytest.approx(illuminance_lx(ours).value_lx, rel=0.005)


def test_the_map_is_that_of_the_reference(ours: LuminanceImage) -> None:
    """Coarse parts are compared: of edges, a pixel's shift makes large differences."""
    cells, part = 20, canon.MAP_PX // 20
    theirs = canon.reference_map().reshape(cells, part, cells, part).mean(axis=(1, 3))
    mine = np.asarray(canon.luminance_cd_m2(ours.rgb)).reshape(cells, 13, cells, 13).mean(axis=(1, 3))
    y, x = np.mgrid[:cells, :cells] - (cells - 1) / 2
    inside = np.hypot(x, y) < 8.5
    ratio = mine[inside] / theirs[inside]
    assert np.median(np.abs(ratio - 1)) < 0.08
    assert np.corrcoef(np.log(mine[inside]), np.log(theirs[inside]))[0, 1] > 0.98


def test_the_image_circle_is_where_it_was_published(bracket: canon.CanonBracket) -> None:
    found, published = find_image_circle(list(bracket.frames)), canon.published_circle(bracket.size_px)
    assert math.dist(found.centre_px, published.centre_px) < 0.01 * published.radius_px
    assert found.radius_px == pytest.approx(published.radius_px, rel=0.02)


def test_a_search_from_the_circle_that_was_found_finds_it_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rounds from a coarse circle stopped 20 full-size pixels short, for light reaches past the rim."""
    frames = [np.asarray(jpeg_frame(path).decode(4)) for path in sorted(canon.FOLDER.glob("*.JPG"))]
    found = find_image_circle(frames)
    monkeypatch.setattr(lens, "_coarse_circle", lambda _: (*found.centre_px, found.radius_px))
    again = find_image_circle(frames)
    assert math.dist(again.centre_px, found.centre_px) < 1
    assert again.radius_px == pytest.approx(found.radius_px, abs=0.5)
    by_short = find_image_circle(frames[3:7])
    assert math.dist(by_short.centre_px, found.centre_px) < 2.5
