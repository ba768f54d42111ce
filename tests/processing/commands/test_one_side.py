"""Sessions of one camera: a room without a sky, a sky without a room, by the command, against the light behind them."""

from __future__ import annotations

import json
import math
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import daylit
from processing.calibration.scale.luminance import Spot, sighted, spot_pixels
from processing.calibration.scale.photometry import UP, illuminance_lx
from processing.ground.colour import srgb_of_linear
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.pictures.modes import modes_of, relative_error
from processing.sphere import Equirectangular, Fisheye, Geometry, LensMapping, directions

TIMES_S = [4.0**-k for k in range(7)]


def light(width: int, height: int) -> np.ndarray:
    """Return patches of 1 to 500 cd/m2 (H, W)."""
    parts = 2 ** np.random.default_rng(5).uniform(0, 9, (height // 12, width // 12))
    return np.repeat(np.repeat(parts, 12, axis=0), 12, axis=1)


def processed(
    folder: Path, side: str, frames: list[np.ndarray], *options: str, meter: tuple[str, str] = ("100", "0,0")
) -> tuple[Path, LuminanceImage]:
    """Import frames of `TIMES_S` and process them as far as they go."""
    camera = folder / "camera"
    camera.mkdir()
    for k, frame in enumerate(frames):
        assert cv2.imwrite(str(camera / f"{k}.png"), frame)
    times = ",".join(f"{t:g}" for t in TIMES_S)
    read = [f"--reading={meter[0]}", f"--target={meter[1]}"] if side == "indoor" else []
    asked = ["import", "one", f"--{side}", str(camera), "--shutter", times, "--into", str(folder / "s"), *read]
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


DISCS = ((0.0, 0.0, 10.0, 8000.0), (30.0, 10.0, 8.0, 1500.0), (-30.0, 10.0, 8.0, 700.0), (0.0, -35.0, 12.0, 60.0))
"""Round parts of a scene at the eye: degrees right of the line of sight and above it, radius, cd/m2."""
AROUND_CD_M2 = 300.0


def looking(width: int, height: int, radius_px: float) -> np.ndarray:
    """Return luminances (H, W) of an equisolid fisheye of 180 degrees that looks ahead: 16 samples a pixel."""
    steps = (np.arange(4) + 0.5) / 4
    x = (np.arange(width)[:, None] + steps).ravel() - width / 2
    y = height / 2 - (np.arange(height)[:, None] + steps).ravel()
    r = np.maximum(np.hypot(x, y[:, None]), 1e-9)
    polar = 2 * np.arcsin(np.minimum(r / radius_px, 1) * math.sin(math.pi / 4))
    right, up, ahead = np.sin(polar) * x / r, np.sin(polar) * y[:, None] / r, np.cos(polar)
    found = np.full(r.shape, AROUND_CD_M2)
    for aside, above, across, level in DISCS:
        a, b = math.radians(aside), math.radians(above)
        towards = right * math.cos(b) * math.sin(a) + up * math.sin(b) + ahead * math.cos(b) * math.cos(a)
        found[towards > math.cos(math.radians(across))] = level
    found[r > radius_px] = 0
    return found.reshape(height, 4, width, 4).mean(axis=(1, 3))


def at_the_eye() -> tuple[float, float]:
    """Return illuminance (lx) and DGP of `DISCS`: cones' projected solid angles, and the formula with P = 1 ahead."""
    eye_lx = math.pi * AROUND_CD_M2
    for aside, above, across, level in DISCS:
        cosine = math.cos(math.radians(aside)) * math.cos(math.radians(above))
        eye_lx += (level - AROUND_CD_M2) * math.pi * math.sin(math.radians(across)) ** 2 * cosine
    _, _, across, level = DISCS[0]
    solid_angle = 2 * math.pi * (1 - math.cos(math.radians(across)))
    source = level**2 * solid_angle / eye_lx**1.87
    return eye_lx, 5.87e-5 * eye_lx + 0.0918 * math.log10(1 + source) + 0.16


@pytest.fixture(scope="module")
def eye_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of a fisheye at the eye, imported from its bracket and processed to the report."""
    folder = tmp_path_factory.mktemp("eye")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DAYLIT_STATE", str(folder / "state"))
        scene = looking(540, 360, 165.0)
        frames = [srgb_of_linear(np.minimum(scene * t / 30, 1)[..., None].repeat(3, axis=2)) for t in TIMES_S]
        options = ["--eye-lens", "equisolid,180"]
        session, _ = processed(folder, "indoor", frames, *options, meter=("1500", "30,10"))
    return session


def test_a_fisheye_at_the_eye_gives_the_light_there(eye_session: Path) -> None:
    figures = json.loads((eye_session / "stages/figures/light_figures.json").read_text())
    (look,), (lux, dgp) = figures["camera"]["directions"], at_the_eye()
    for found, known in ((look["vertical"], lux), (look["glare"]["dgp"], dgp), (look["indices"]["ev_lx"], lux)):
        assert found["value"] == pytest.approx(known, rel=0.02)
        assert 0 < abs(found["value"] - known) < 2 * found["uncertainty"] < 0.2 * known
    assert look["glare"]["sources"] == 1
    assert {"dgi", "ugr", "cgi", "vcp_pct", "ugp", "lveil_cd_m2"} <= look["indices"].keys()
    assert figures["camera"]["level_up"] is None
    assert figures["meter"]["picture_cd_m2"] == pytest.approx(1500, rel=0.005)


def test_an_eyes_stray_light_is_in_the_meters_reading(eye_session: Path) -> None:
    """At the spot nothing of it is left uncertain; beside it, something is."""
    image = read_exr(eye_session / "stages/calibrate/indoor.exr")
    spot = spot_pixels(image.geometry, Spot(*sighted(image.geometry, math.radians(30), math.radians(10))))
    level = luminance_cd_m2(image.rgb)
    stray = [mode for mode in modes_of(image) if mode.name.startswith("stray light")]
    errors = [relative_error(mode, image, level) for mode in stray]
    assert math.hypot(*(spot.mean(one) for one in errors)) < 0.0015
    assert math.hypot(*(one[image.validity == 0].mean() for one in errors)) > 0.003


def test_evalglare_agrees_about_a_fisheye_at_the_eye(
    eye_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pyradiance = pytest.importorskip("pyradiance", reason="an oracle of the bench extra")
    monkeypatch.setenv("PATH", str(Path(pyradiance.__file__).parent / "bin"), prepend=os.pathsep)
    asked = ["export", str(eye_session), "--what", "glare", "--into", str(tmp_path), "--json"]
    assert daylit.main(asked) in (0, None)
    ((name, theirs),) = json.loads(capsys.readouterr().out)["evalglare"].items()
    assert name.endswith("_eye-000.hdr")
    figures = json.loads((eye_session / "stages/figures/light_figures.json").read_text())
    ours = figures["camera"]["directions"][0]["indices"]
    assert theirs["dgp"] == pytest.approx(ours["dgp"]["value"], abs=0.015)
    for name in ("dgi", "ugr", "cgi"):
        assert theirs[name] == pytest.approx(ours[name]["value"], abs=0.35)


def test_a_fisheye_at_the_eye_has_no_room_and_says_so(eye_session: Path) -> None:
    for stage in ("room", "detect", "light", "remove", "arrange", "stills"):
        result = json.loads((eye_session / "stages" / stage / "result.json").read_text())
        assert result["skipped"], stage
        assert "--room" not in result["skipped"]
    page = (eye_session / "stages/report/lab.html").read_text()
    assert "At the eye" in page
    assert "equisolid as asked; image circle found in the picture" in page


def test_the_certificate_of_a_fisheye_at_the_eye_is_of_the_eye(
    eye_session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert daylit.main(["certificate", str(eye_session), "--into", str(tmp_path), "--json"]) in (0, None)
    (budget,) = json.loads(capsys.readouterr().out)["budgets"]
    assert budget["figure"] == "indoor, illuminance at the eye"
    assert budget["value"] == pytest.approx(at_the_eye()[0], rel=0.02)
    assert {"meter", "spot"} <= {row["cause"] for row in budget["rows"]}


def test_an_unknown_lens_at_the_eye_is_assumed_and_said(eye_session: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(eye_session, tmp_path / "copy")
    assert daylit.main(["process", str(copy), "--until", "calibrate", "--forget", "eye-lens"]) in (0, None)
    warnings = json.loads((copy / "stages/calibrate/result.json").read_text())["warnings"]
    assert any("taken as equisolid,180 degrees" in one["message"] for one in warnings)
