"""Legs of a tripod at the nadir, by what they look like alone."""

from __future__ import annotations

import cv2
import numpy as np

from processing.removal.tripod import SIZE_PX, find_tripod, onto_panorama, thin_and_dark

HEIGHT = 256
LEGS = ((0.1, -0.35), (0.4, 0.1), (-0.3, 0.3))
"""Where they end, in the nadir picture's halves."""
FLOOR, BLACK = (180, 120, 60), (16, 14, 12)


def nadir(legs: bool) -> np.ndarray:
    """A wooden floor from above: boards with gaps, a dark rug around, and black legs or none."""
    picture = np.full((SIZE_PX, SIZE_PX, 3), FLOOR, np.uint8)
    cv2.circle(picture, (SIZE_PX // 2, SIZE_PX // 2), SIZE_PX // 2, (30, 25, 20), 60)
    picture[::24] = (140, 95, 50)
    middle = SIZE_PX // 2
    for x, y in LEGS if legs else ():
        end = (round(middle + x * middle), round(middle + y * middle))
        cv2.line(picture, (middle, middle), end, BLACK, 6)
    return picture


def panorama(picture: np.ndarray) -> np.ndarray:
    channels = [onto_panorama(picture[..., k].astype(np.float32), (HEIGHT, 2 * HEIGHT)) for k in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def found(picture: np.ndarray) -> tuple[np.ndarray, bool]:
    floor = np.zeros((HEIGHT, 2 * HEIGHT), bool)
    floor[HEIGHT // 2 :] = True
    result = find_tripod(np.zeros((8, HEIGHT, 2 * HEIGHT), np.float32), panorama(picture), floor)
    return result.mask, result.at_nadir


def test_black_legs_are_found_though_the_floor_around_is_as_dark() -> None:
    legs = np.zeros((SIZE_PX, SIZE_PX), np.float32)
    legs[(nadir(True) != nadir(False)).any(axis=2)] = 1
    true = onto_panorama(legs, (HEIGHT, 2 * HEIGHT)) > 0.5
    mask, at_nadir = found(nadir(True))
    assert at_nadir
    assert (mask & true).sum() > 0.9 * true.sum()


def test_gaps_of_boards_are_no_legs() -> None:
    mask, at_nadir = found(nadir(False))
    assert not at_nadir
    assert not mask.any()
    assert thin_and_dark(nadir(False))[100:220, 100:220].max() < 0.1


def test_black_and_white_floors_have_no_legs() -> None:
    for code in (0, 255):
        assert not thin_and_dark(np.full((SIZE_PX, SIZE_PX, 3), code, np.uint8)).any()


def test_feet_beyond_a_painted_disc_go_with_it() -> None:
    """The nadir is painted over; three pale feet show at its rim, and the same spot farther out is the floor's own."""
    picture = nadir(False)
    rng = np.random.default_rng(3)
    picture = np.clip(picture + rng.normal(0, 6, picture.shape), 0, 255).astype(np.uint8)
    middle = SIZE_PX // 2
    cv2.circle(picture, (middle, middle), 40, (120, 110, 100), -1)
    feet, far = np.zeros((SIZE_PX, SIZE_PX), np.float32), np.zeros((SIZE_PX, SIZE_PX), np.float32)
    for x, y in ((0, -44), (-38, 22), (38, 22)):
        cv2.circle(picture, (middle + x, middle + y), 4, (230, 230, 235), -1)
        cv2.circle(feet, (middle + x, middle + y), 3, 1.0, -1)
    cv2.circle(picture, (middle + 70, middle), 4, (230, 230, 235), -1)
    cv2.circle(far, (middle + 70, middle), 3, 1.0, -1)
    mask, at_nadir = found(picture)
    assert at_nadir
    shape = (HEIGHT, 2 * HEIGHT)
    assert mask[onto_panorama(feet, shape) > 0.5].mean() > 0.9
    assert not mask[onto_panorama(far, shape) > 0.5].any()
