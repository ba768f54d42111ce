"""The shipped network on small pictures: what must hold whatever its weights are."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from processing.errors import ParameterError, SegmenterError
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.segmentation import embedded
from processing.segmentation.embedded import SHIPPED
from processing.segmentation.evidence import SceneClass
from processing.sphere import Equirectangular, Perspective
from tests.once import all_anew, once

ROWS = 128
scene_evidence = once(embedded.scene_evidence)
"""Several tests compare with the plain room."""


def image_of(rgb: np.ndarray, yaw_rad: float = 0.0) -> RelativeImage:
    rgb = np.asarray(rgb, np.float32)
    shape = rgb.shape[:2]
    geometry = Equirectangular(shape[1], shape[0], yaw_rad)
    return RelativeImage(rgb, np.full(shape, 0.01, np.float32), np.zeros(shape, np.uint8), geometry)


def box_room(rows: int = ROWS) -> np.ndarray:
    """Return a plainly painted box room with a window (sky, land, bars) and a dark block on its floor, linear light."""
    longitude = ((np.arange(2 * rows) + 0.5) / (2 * rows) - 0.5) * (2 * np.pi)
    latitude = (0.5 - (np.arange(rows) + 0.5) / rows) * np.pi
    x, y = np.sin(longitude), np.cos(longitude)
    far = np.minimum(np.where(x > 0, 2.2, 1.8) / np.abs(x), np.where(y > 0, 2.8, 1.6) / np.abs(y))
    side = np.where(np.where(x > 0, 2.2, 1.8) / np.abs(x) < np.where(y > 0, 2.8, 1.6) / np.abs(y), 0.75, 1.0)
    high, low = np.arctan2(1.05, far), np.arctan2(-1.5, far)
    row = latitude[:, None]
    picture = np.where(row > high, 0.8, np.where(row < low, 0.25, 0.6 * side))[..., None] * np.ones(3)
    picture[(row < low)] *= (1.1, 0.9, 0.7)
    window = (np.abs(longitude)[None] < 0.25) & (row > -0.1) & (row < 0.25)
    picture[window] = (5.0, 6.0, 7.0)
    picture[window & (row < 0.05)] = (1.5, 1.9, 1.2)
    bars = (np.abs(np.abs(longitude) - 0.125)[None] > 0.105) | (row < -0.075) | (row > 0.225)
    picture[window & bars] = 0.7
    block = (np.abs(longitude - 1.9)[None] < 0.3) & (row > -0.75) & (row < -0.3)
    picture[block] = (0.05, 0.06, 0.1)
    return picture


def test_what_comes_back_keeps_its_contract() -> None:
    evidence = scene_evidence(image_of(box_room()))
    assert evidence.probabilities.shape == (len(SceneClass), 128, 256)
    assert evidence.probabilities.dtype == np.float32
    np.testing.assert_allclose(evidence.probabilities.sum(axis=0), 1.0, atol=1e-5)
    edges = evidence.boundary
    assert edges is not None
    assert edges.ceiling_rad.shape == edges.floor_sigma_rad.shape == edges.corner.shape == (256,)
    assert (edges.ceiling_rad > 0).all()
    assert (edges.floor_rad < 0).all()
    assert (edges.ceiling_sigma_rad > 0).all()
    assert (edges.floor_sigma_rad > 0).all()
    assert 0 <= edges.corner.min() <= edges.corner.max() <= 1
    assert evidence.views_used == 2


def test_a_plain_box_room_is_understood() -> None:
    evidence = scene_evidence(image_of(box_room()), quality="standard")
    found = evidence.probabilities.argmax(axis=0)
    assert (found[4:16] == SceneClass.CEILING).mean() > 0.9
    assert (found[108:118] == SceneClass.FLOOR).mean() > 0.8
    assert (found[56:66, 121:135] == SceneClass.WINDOW).mean() > 0.7
    assert evidence.boundary is not None
    for column, wall_m in ((0, 1.6), (64, 1.8), (128, 2.8)):
        assert np.degrees(abs(evidence.boundary.floor_rad[column] - np.arctan2(-1.5, wall_m))) < 2.5
        assert np.degrees(abs(evidence.boundary.ceiling_rad[column] - np.arctan2(1.05, wall_m))) < 2.5


@pytest.mark.long
def test_equal_pictures_give_equal_answers() -> None:
    with all_anew():
        one, two = (scene_evidence(image_of(box_room())) for _ in range(2))
    assert (one.probabilities == two.probabilities).all()
    assert one.boundary is not None
    assert two.boundary is not None
    assert (one.boundary.floor_rad == two.boundary.floor_rad).all()


@pytest.mark.long
def test_a_turned_picture_gives_the_turned_answer() -> None:
    picture = box_room()
    straight = scene_evidence(image_of(picture), quality="reference")
    turned = scene_evidence(image_of(np.roll(picture, 43, axis=1)), quality="reference")
    back = np.roll(turned.probabilities, -43, axis=2)
    assert np.abs(back - straight.probabilities).mean() < 0.01
    assert straight.boundary is not None
    assert turned.boundary is not None
    away = np.abs(np.roll(turned.boundary.floor_rad, -43) - straight.boundary.floor_rad)
    assert np.degrees(away).mean() < 0.6


@pytest.mark.long
def test_a_mirrored_picture_gives_the_mirrored_answer() -> None:
    picture = box_room()
    straight = scene_evidence(image_of(picture), quality="reference")
    mirrored = scene_evidence(image_of(picture[:, ::-1]), quality="reference")
    assert np.abs(mirrored.probabilities[..., ::-1] - straight.probabilities).mean() < 0.01


def test_scale_and_type_do_not_matter() -> None:
    picture = box_room().astype(np.float32)
    relative = image_of(picture)
    luminance = LuminanceImage(
        picture * np.float32(400), relative.uncertainty, relative.validity, relative.geometry, 0.05
    )
    one, two = scene_evidence(relative, quality="draft"), scene_evidence(luminance, quality="draft")
    np.testing.assert_allclose(one.probabilities, two.probabilities, atol=2e-3)


def test_a_sun_in_the_picture_changes_nothing_elsewhere() -> None:
    picture = box_room(256)
    plain = scene_evidence(image_of(picture), quality="draft").probabilities
    picture[100, 256] = 1.6e9 / 400
    with_sun = scene_evidence(image_of(picture), quality="draft").probabilities
    assert np.abs(with_sun - plain)[:, 80:].mean() < 0.005


@pytest.mark.parametrize("level", [0.0, 0.7, 1e9])
def test_a_picture_of_one_tone_says_nothing(level: float) -> None:
    evidence = scene_evidence(image_of(np.full((16, 32, 3), level)))
    assert evidence.boundary is None
    assert evidence.notes
    np.testing.assert_allclose(evidence.probabilities, 1 / len(SceneClass), rtol=1e-6)


@pytest.mark.parametrize("rows", [4, 33, pytest.param(128, marks=pytest.mark.long)])
def test_noise_and_clipped_pictures_give_finite_answers(rows: int) -> None:
    rng = np.random.default_rng(rows)
    for picture in (rng.random((rows, 2 * rows, 3)), np.minimum(rng.exponential(5, (rows, 2 * rows, 3)), 1)):
        evidence = scene_evidence(image_of(picture), quality="draft")
        assert np.isfinite(evidence.probabilities).all()
        assert evidence.boundary is not None
        assert np.isfinite(evidence.boundary.floor_rad).all()
        assert (evidence.boundary.floor_sigma_rad > 0).all()


def test_pictures_that_cannot_be_are_refused() -> None:
    picture = box_room(16)
    picture[3, 4, 0] = np.nan
    with pytest.raises(ParameterError, match="light cannot have"):
        scene_evidence(image_of(picture))
    with pytest.raises(ParameterError, match="longitude 0"):
        scene_evidence(image_of(box_room(16), yaw_rad=0.3))
    with pytest.raises(ParameterError, match="quality"):
        scene_evidence(image_of(box_room(16)), quality="best")
    view = image_of(box_room(16))
    flat = RelativeImage(view.rgb, view.uncertainty, view.validity, Perspective(32, 16, 1.0))
    with pytest.raises(ParameterError, match="equirectangular"):
        scene_evidence(flat)


def test_the_file_is_small_and_the_one_its_page_names() -> None:
    assert SHIPPED.stat().st_size <= 25_000_000
    assert scene_evidence(image_of(box_room(16))).source == json.loads(SHIPPED.with_suffix(".json").read_text())["name"]


def copied(folder: Path) -> Path:
    for path in (SHIPPED, SHIPPED.with_suffix(".json")):
        shutil.copy(path, folder / path.name)
    return folder / SHIPPED.name


def test_a_changed_network_is_refused(tmp_path: Path) -> None:
    model = copied(tmp_path)
    assert scene_evidence(image_of(box_room(16)), model=model).boundary is not None
    data = bytearray(model.read_bytes())
    data[len(data) // 2] ^= 1
    model.write_bytes(bytes(data))
    with pytest.raises(SegmenterError, match="does not match its JSON"), all_anew():
        scene_evidence(image_of(box_room(16)), model=model)


@pytest.mark.parametrize("page", ["", "[]", "{}", '{"name": "x", "sha256": 3}'])
def test_a_damaged_page_is_refused(tmp_path: Path, page: str) -> None:
    model = copied(tmp_path)
    model.with_suffix(".json").write_text(page)
    with pytest.raises(SegmenterError):
        scene_evidence(image_of(box_room(16)), model=model)


def test_missing_and_foreign_networks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SegmenterError, match="missing"):
        scene_evidence(image_of(box_room(16)), model=tmp_path / "none.onnx")
    import hashlib

    model = copied(tmp_path)
    model.write_bytes(b"no network")
    page = json.loads(model.with_suffix(".json").read_text())
    page["sha256"] = hashlib.sha256(b"no network").hexdigest()
    model.with_suffix(".json").write_text(json.dumps(page))
    with pytest.raises(SegmenterError, match="cannot be loaded"):
        scene_evidence(image_of(box_room(16)), model=model)
