"""Sessions of one camera: a room without a sky, a sky without a room, by the command, against the light behind them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import daylit
from processing.calibration.scale.photometry import UP, illuminance_lx
from processing.ground.colour import srgb_of_linear
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, directions

TIMES_S = [4.0**-k for k in range(7)]


def light(width: int, height: int) -> np.ndarray:
    """Return patches of 1 to 500 cd/m2 (H, W)."""
    parts = 2 ** np.random.default_rng(5).uniform(0, 9, (height // 12, width // 12))
    return np.repeat(np.repeat(parts, 12, axis=0), 12, axis=1)


def processed(folder: Path, side: str, frames: list[np.ndarray], *options: str) -> tuple[Path, LuminanceImage]:
    """Import frames of `TIMES_S` and process them as far as they go."""
    camera = folder / "camera"
    camera.mkdir()
    for k, frame in enumerate(frames):
        assert cv2.imwrite(str(camera / f"{k}.png"), frame)
    times = ",".join(f"{t:g}" for t in TIMES_S)
    meter = ["--reading", "100", "--target", "0,0"] if side == "indoor" else []
    asked = ["import", "one", f"--{side}", str(camera), "--shutter", times, "--into", str(folder / "s"), *meter]
    assert daylit.main(asked) in (0, None)
    session = next((folder / "s").iterdir())
    assert daylit.main(["process", str(session), *options]) in (0, None)
    image = read_exr(session / "stages" / "calibrate" / f"{side}.exr")
    assert isinstance(image, LuminanceImage)
    return session, image


def truth(rgb: np.ndarray, geometry: Geometry) -> LuminanceImage:
    _, seen = directions(geometry)
    picture = np.where(seen, rgb, 0).astype(np.float32)[..., None].repeat(3, axis=2)
    validity = np.where(seen, 0, 3).astype(np.uint8)
    return LuminanceImage(picture, np.full(rgb.shape, 1e-6, np.float32), validity, geometry, 0.0)


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DAYLIT_STATE", str(tmp_path / "state"))


def test_a_room_without_a_sky_is_measured(tmp_path: Path) -> None:
    scene = light(384, 192)
    scene[84:108, 180:204] = 100
    frames = [srgb_of_linear(np.minimum(scene * t / 30, 1)[..., None].repeat(3, axis=2)) for t in TIMES_S]
    session, image = processed(tmp_path, "indoor", frames, "--until", "calibrate")
    known = truth(scene, Equirectangular(384, 192))
    lux = illuminance_lx(image, UP)
    assert lux.value_lx == pytest.approx(illuminance_lx(known, UP).value_lx, rel=0.03)
    assert lux.uncertainty_lx > 0.01 * lux.value_lx
    assert "outdoor" in json.loads((session / "stages/calibrate/result.json").read_text())["left_out"]


def test_a_sky_without_a_room_is_measured_and_ends_there(tmp_path: Path) -> None:
    lens = Fisheye(240, 240, LensMapping.EQUIDISTANT, 120.0)
    scene = light(240, 240) * directions(lens)[1]
    known = illuminance_lx(truth(scene, lens), UP).value_lx
    shown = [srgb_of_linear(np.minimum(scene * t / 30, 1)[..., None].repeat(3, axis=2)) for t in TIMES_S]
    frames = [np.pad(one, ((4, 4), (60, 60), (0, 0))) for one in shown]
    session, image = processed(tmp_path, "outdoor", frames, "--outdoor-lux", f"{known:.6g}")
    assert illuminance_lx(image, UP).value_lx == pytest.approx(known, rel=0.01)
    middle = image.rgb[image.rgb.shape[0] // 2, image.rgb.shape[1] // 2].mean()
    assert 1 < middle < 520
    assert not (session / "stages" / "room").exists()


def test_a_fisheye_at_the_eye_is_no_room_and_is_sent_to_its_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lens = Fisheye(240, 240, LensMapping.EQUIDISTANT, 120.0)
    scene = light(240, 240) * directions(lens)[1]
    shown = [srgb_of_linear(np.minimum(scene * t / 30, 1)[..., None].repeat(3, axis=2)) for t in TIMES_S]
    with pytest.raises(AssertionError):
        processed(tmp_path, "indoor", [np.pad(one, ((4, 4), (60, 60), (0, 0))) for one in shown])
    said = capsys.readouterr().err
    assert "fisheye's circle" in said
    assert "daylit figures SESSION/indoor --view fisheye" in said
    assert not (next((tmp_path / "s").iterdir()) / "stages" / "merge").exists()
