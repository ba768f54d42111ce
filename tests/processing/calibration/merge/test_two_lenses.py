"""Raw pictures of two lenses: placed and tied by the camera's panorama, against a simulation of another family."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from benchmarks.hostile.two_lenses import misplaced_deg
from mocks.optics.lenses import TwoFisheyes
from processing.calibration.merge.bracket import Merged, MergeReport, Shares
from processing.calibration.merge.lens_pair import LensPair, stitched
from processing.calibration.merge.lens_places import clearest, place_lenses
from processing.errors import BracketError
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import SEAM_KEY
from processing.pictures.mosaic import FULL, PEDESTAL, CameraColours
from processing.sphere import Equirectangular
from tests.conftest import LONG

COLOURS = CameraColours(np.eye(3), np.array([[0, 1], [1, 2]]))
HEIGHT, SIDE = 224, 238
BODY = TwoFisheyes(gains=(1.0, 1.06))


def room(seed: int = 5) -> np.ndarray:
    """A room's light as a panorama (H, 2 H, 3), 0.02 to 0.9: patches of many sizes, brighter towards one side."""
    rng = np.random.default_rng(seed)
    light = np.zeros((HEIGHT, 2 * HEIGHT, 3))
    for cells in (8, 16, 32):
        part = rng.normal(0, 0.5, (cells, 2 * cells, 1)) + rng.normal(0, 0.08, (cells, 2 * cells, 3))
        light += cv2.resize(part, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_NEAREST)
    light += np.cos(np.linspace(-math.pi, math.pi, 2 * HEIGHT))[None, :, None] * 0.5
    # No lens draws edges sharper than this.
    return cv2.GaussianBlur(np.clip(0.2 * np.exp(light), 0.02, 0.9).astype(np.float32), (0, 0), 0.7)


def codes(light: np.ndarray) -> np.ndarray:
    return np.clip(PEDESTAL + (FULL - PEDESTAL) * light, 0, FULL).astype(np.uint16)


def jpeg(light: np.ndarray) -> np.ndarray:
    """What the camera makes of it: a curve of its own, no power of anything."""
    return np.round(255 * np.log1p(20 * np.clip(light, 0, 1)) / math.log(21)).astype(np.uint8)


def placed(optics: TwoFisheyes = BODY, seed: int = 5) -> LensPair:
    light = room(seed)
    return place_lenses(codes(optics.picture(light, SIDE)), COLOURS, jpeg(light))


@pytest.fixture(scope="module")
def pair() -> LensPair:
    return placed()


def merged(light: np.ndarray, ghost: np.ndarray | None = None) -> Merged:
    height, width = light.shape[:2]
    image = RelativeImage(
        np.ascontiguousarray(light, dtype=np.float32),
        np.full((height, width), 0.01, np.float32),
        np.zeros((height, width), np.uint8),
        Equirectangular(width, height),
        ghost,
        {"made": "by hand"},
    )
    return Merged(image, MergeReport((), (), Shares(0, 0, 0), []))


def test_lenses_are_placed_to_a_part_of_a_pixel(pair: LensPair) -> None:
    place, rim = misplaced_deg(pair, BODY)
    assert place < 0.1
    assert rim < 0.3
    assert pair.off_rad < math.radians(0.2)


def test_exposures_are_tied_in_the_overlap_though_the_jpeg_hides_them(pair: LensPair) -> None:
    found = pair.to_dict()
    assert found["second_stops"] == pytest.approx(math.log2(1.06), abs=0.01)
    assert found["edge_light"] == pytest.approx(0.7, abs=0.02)
    assert 0.002 <= pair.seam_sigma < 0.01


BODIES = ("tilted", "swapped", "circles cut by the border", "quarters", "smaller circles")


@pytest.mark.sweep
@pytest.mark.parametrize("turned", BODIES if LONG else BODIES[:1])
def test_any_body_is_placed(turned: str) -> None:
    optics = {
        "quarters": replace(BODY, rolls_rad=(math.pi + 0.02, 0.03)),
        "swapped": replace(BODY, tilts_rad=((math.pi + 0.01, 0.02), (math.pi - 0.02, 0.0))),
        "circles cut by the border": replace(BODY, circle=1.03),
        # As where the camera has levelled its panorama
        "tilted": replace(
            BODY, tilts_rad=((0.07, 0.14), (0.07, -0.14)), rolls_rad=(math.pi / 2 + 0.05, -math.pi / 2 - 0.05)
        ),
        "smaller circles": replace(BODY, circle=0.85, half_field_rad=math.radians(95), squeeze=0.2),
    }[turned]
    assert max(misplaced_deg(placed(optics), optics)) < 0.4


def test_the_stitched_panorama_is_the_rooms_light(pair: LensPair) -> None:
    light = room()
    made = stitched(merged(BODY.picture(light, SIDE)), pair, Equirectangular(2 * HEIGHT, HEIGHT))
    image = made.image
    assert image.rgb.shape == light.shape
    assert image.attributes[SEAM_KEY] == pair.seam_sigma
    assert image.attributes["made"] == "by hand"
    assert (image.validity == Validity.VALID).all()
    ratio = luminance_cd_m2(image.rgb) / luminance_cd_m2(light)
    ratio /= np.median(ratio)
    assert np.median(np.abs(ratio - 1)) < 0.02
    # No step at the seam, and none between the lenses
    q = HEIGHT // 2
    halves = [np.median(ratio[:, part]) for part in (slice(q + 2, 3 * q - 2), np.r_[: q - 2, 3 * q + 2 : 4 * q])]
    assert halves[0] / halves[1] == pytest.approx(1, abs=0.01)
    off = np.abs(np.log(ratio))
    assert np.mean(off < 1.96 * image.uncertainty) > 0.85


def test_clipped_dark_and_moved_pixels_keep_their_marks(pair: LensPair) -> None:
    light = BODY.picture(room(), SIDE)
    ghost = np.zeros(light.shape[:2], np.uint8)
    given = merged(light, ghost)
    around = slice(SIDE // 2 - 12, SIDE // 2 + 12)
    given.image.validity[around, around] = Validity.CLIPPED
    given.image.uncertainty[around, around] = np.inf
    second = slice(SIDE // 2 + SIDE - 12, SIDE // 2 + SIDE + 12)
    given.image.uncertainty[around, second] = np.inf
    ghost[around, second] = 3
    found = stitched(given, pair, Equirectangular(2 * HEIGHT, HEIGHT))
    image = found.image
    middle, back = (HEIGHT // 2, HEIGHT), (HEIGHT // 2, 2)
    assert image.validity[middle] == Validity.CLIPPED
    assert np.isinf(image.uncertainty[middle])
    assert image.validity[back] == Validity.DARK
    assert image.ghost is not None
    assert image.ghost[back] == 3
    assert image.ghost[middle] == 0
    assert found.report.shares.clipped == pytest.approx(np.mean(image.validity == Validity.CLIPPED))
    assert 0.001 < found.report.shares.dark < 0.02


def test_circles_that_end_before_the_lenses_meet_are_refused() -> None:
    with pytest.raises(BracketError, match="need to meet"):
        placed(replace(BODY, circle=1.1))


def test_another_rooms_panorama_is_refused() -> None:
    with pytest.raises(BracketError, match=r"do not match its panorama|fit its panorama"):
        place_lenses(codes(BODY.picture(room(5), SIDE)), COLOURS, jpeg(room(6)))


@pytest.mark.parametrize("value", [0.0, 0.3, 2.0])
def test_a_picture_without_edges_is_refused(value: float) -> None:
    plain = np.full((HEIGHT, 2 * HEIGHT, 3), value, np.float32)
    with pytest.raises(BracketError):
        place_lenses(codes(BODY.picture(plain, SIDE)), COLOURS, jpeg(plain))


def test_a_stitched_raw_picture_is_refused() -> None:
    light = room()
    with pytest.raises(BracketError, match=r"do not match its panorama|fit its panorama"):
        place_lenses(codes(light), COLOURS, jpeg(light))
    with pytest.raises(BracketError, match="300 x 200 wells"):
        place_lenses(np.zeros((200, 300, 3), np.uint16), COLOURS, jpeg(light))


@pytest.mark.long
def test_a_moved_seam_is_said_in_its_sigma() -> None:
    light = room()
    seen = BODY.picture(light, SIDE)
    # The second lens is shaded on one side, as by a finger.
    seen[:, SIDE:] *= np.linspace(0.9, 1.1, SIDE)[:, None, None].astype(np.float32)
    found = place_lenses(codes(seen), COLOURS, jpeg(light))
    assert found.seam_sigma > 0.02


def test_the_clearest_frame_is_chosen() -> None:
    light = room()
    raws = [codes(gain * light) for gain in (1e-4, 0.9, 40.0)]
    assert clearest(raws, [jpeg(gain * light) for gain in (1e-4, 0.9, 40.0)]) == 1
