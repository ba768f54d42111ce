"""The engine that the rooms are rendered with, against calculation: issue-wide limits, fixed seeds, few samples."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import dblquad

from benchmarks.light import analytic
from benchmarks.light import physics as _physics
from benchmarks.photometry import spot as _spot
from mocks.rooms.light import engine as engines
from mocks.rooms.light.engine import EngineError, environment_emitter, irradiance_at, mesh_shape, mitsuba, sun_emitter
from processing.ground import mitsuba_variants
from processing.ground.arrays import Floats
from processing.ground.mesh import quad

WHITE = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
DOWN = (0.0, 0.0, -1.0)


def worst(errors: dict[str, float]) -> tuple[float, str]:
    return max((abs(error), case) for case, error in errors.items())


def test_white_furnace() -> None:
    assert worst(_physics.furnace(2**14, 3)) < (1.0, "")


def test_integrating_cube_and_sphere() -> None:
    assert worst(_physics.integrating(2**13, 1)) < (1.0, "")


def test_form_factors_of_parallel_and_perpendicular_rectangles() -> None:
    assert worst(_physics.form_factors(2**16, 1)) < (1.0, "")


@pytest.mark.long
def test_daylight_through_unglazed_openings() -> None:
    assert worst(_physics.daylight(2**15, 1)) < (2.0, "")


def test_meter_spot_is_the_mean_over_the_spot() -> None:
    assert worst(_spot.spot_errors(0)) < (0.1, "")


def test_closed_forms_agree_with_each_other() -> None:
    assert analytic.parallel_form_factor(5, 4, 2.7) == pytest.approx(0.3506, abs=5e-5)
    closure = analytic.parallel_form_factor(5, 4, 2.7)
    closure += 2 * analytic.perpendicular_form_factor(5, 2.7, 4) + 2 * analytic.perpendicular_form_factor(4, 2.7, 5)
    assert closure == pytest.approx(1.0, abs=1e-12)
    assert analytic.open_ground_lux(analytic.overcast) == pytest.approx(7 * math.pi / 9, rel=1e-12)
    walsh = analytic.overcast_behind_facade_lux(2.0, 1.5, 1.0)
    opening = ((0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (0.0, 0.0, 1.0))
    seen = analytic.through_opening_lux((0.0, 2.0, 0.0), (0.0, 0.0, 1.0), opening, analytic.overcast)
    assert seen == pytest.approx(walsh, rel=1e-9)


def test_quadrature_agrees_with_another_in_angles() -> None:
    opening = ((-1.0, 0.0, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 1.5))
    found = analytic.through_opening_lux((0.0, 2.0, 0.5), (0.0, 0.0, 1.0), opening, analytic.overcast)

    def light(elevation: float, _azimuth: float) -> float:
        return float(analytic.overcast(np.array(math.sin(elevation)))) * math.sin(elevation) * math.cos(elevation)

    side = math.atan2(1.0, 2.0)
    wanted, _ = dblquad(
        light, -side, side, lambda a: math.atan(0.5 * math.cos(a) / 2), lambda a: math.atan(2 * math.cos(a) / 2)
    )
    assert found == pytest.approx(wanted, rel=1e-9)


def uniform_map() -> Floats:
    return np.full((32, 64, 3), (1.0, 2.0, 3.0), dtype=np.float32)


def cosine_map() -> Floats:
    sine = np.sin(math.pi * (0.5 - (np.arange(32) + 0.5) / 32))
    return np.repeat(np.maximum(sine, 0)[:, None, None], 64, axis=1).astype(np.float32) * np.ones(3, dtype=np.float32)


def single_pixel_map(row: int) -> Floats:
    picture = np.zeros((32, 64, 3), dtype=np.float32)
    picture[row, 40] = (1000.0, 2000.0, 500.0)
    return picture


def eval_emitter(emitter: object, directions: np.ndarray) -> np.ndarray:
    import drjit as dr

    mi = mitsuba()
    out = []
    # One direction at a time works in every variant; LLVM could take all at once.
    batches = [directions] if mi.variant() != "scalar_rgb" else directions[:, None, :]
    for batch in batches:
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(*(-batch.T if len(batch) > 1 else [float(-v) for v in batch[0]]))
        out.append(np.array(emitter.eval(si)).reshape(3, -1).T)  # type: ignore[attr-defined]
    return np.concatenate(out)


@pytest.mark.parametrize(("row", "off_deg"), [(0, 2.8), (1, 1.2), (9, 0.2), (16, 0.2), (31, 2.8)])
def test_sky_map_keeps_the_light_of_a_single_pixel_in_its_place(row: int, off_deg: float) -> None:
    """All of its energy; its middle within half a pixel at the poles, a thirtieth elsewhere."""
    emitter = mitsuba().load_dict(environment_emitter(single_pixel_map(row)))
    fine = 12
    u, v = np.meshgrid(np.arange(38.5, 43, 1 / fine) + 0.5 / fine, np.arange(row - 2, row + 3, 1 / fine) + 0.5 / fine)
    kept = (v > 0) & (v < 32)
    longitude, latitude = (u[kept] / 64 - 0.5) * 2 * math.pi, (0.5 - v[kept] / 32) * math.pi
    flat = np.cos(latitude)
    directions = np.stack([flat * np.sin(longitude), flat * np.cos(longitude), np.sin(latitude)], axis=-1)
    # Each sample's own solid angle, exactly.
    edges = (0.5 - (v[kept][:, None] + np.array([-0.5, 0.5]) / fine) / 32) * math.pi
    solid_angle = (np.sin(edges[:, 0]) - np.sin(edges[:, 1])) * 2 * math.pi / 64 / fine
    light = eval_emitter(emitter, directions) * solid_angle[:, None]
    rows = np.sin(math.pi * (0.5 - np.array([row, row + 1]) / 32))
    wanted = np.array([1000.0, 2000.0, 500.0]) * (rows[0] - rows[1]) * 2 * math.pi / 64
    np.testing.assert_allclose(light.sum(axis=0), wanted, rtol=4e-3)
    middle = (0.5 - (row + 0.5) / 32) * math.pi
    azimuth = (40.5 / 64 - 0.5) * 2 * math.pi
    centre = np.array([math.cos(middle) * math.sin(azimuth), math.cos(middle) * math.cos(azimuth), math.sin(middle)])
    mean = (light[:, 1:2] * directions).sum(axis=0)
    assert math.degrees(math.acos(mean @ centre / np.linalg.norm(mean))) < off_deg


@pytest.mark.parametrize(
    "picture", [uniform_map(), cosine_map(), single_pixel_map(5)], ids=["uniform", "cosine", "one"]
)
def test_sky_map_lights_a_sheet_as_our_own_quadrature_says(picture: Floats) -> None:
    scene = mitsuba().load_dict(
        {
            "type": "scene",
            "sheet": mesh_shape(quad((-2, -2, 0), (4, 0, 0), (0, 4, 0)), WHITE),
            "sky": environment_emitter(picture),
        }
    )
    found = irradiance_at(scene, (0.0, 0.0, 0.002), DOWN, 2**15, 5)
    edges = np.sin(math.pi * (0.5 - np.arange(33) / 32))
    # The integral of sin(elevation) over each pixel.
    weight = (np.maximum(edges[:-1], 0) ** 2 - np.maximum(edges[1:], 0) ** 2) / 2 * 2 * math.pi / 64
    wanted = (picture.astype(np.float64) * weight[:, None, None]).sum(axis=(0, 1))
    np.testing.assert_allclose(found, wanted, rtol=5e-3)


def test_sun_lights_a_sheet_by_the_cosine_of_its_angle() -> None:
    direction = np.array((0.3, 0.4, 0.8)) / np.linalg.norm((0.3, 0.4, 0.8))
    scene = mitsuba().load_dict(
        {
            "type": "scene",
            "sheet": mesh_shape(quad((-2, -2, 0), (4, 0, 0), (0, 4, 0)), WHITE),
            "sun": sun_emitter((0.3, 0.4, 0.8), (80e3, 70e3, 60e3)),
        }
    )
    found = irradiance_at(scene, (0.0, 0.0, 0.002), DOWN, 2**12, 5)
    np.testing.assert_allclose(found, np.array((80e3, 70e3, 60e3)) * direction[2], rtol=1e-3)


def test_sun_is_a_disc_of_its_true_size() -> None:
    """A blind's edge, 5 m away, hides half of the sun, then all of it, over 46 mm."""
    blind = quad((-1, 0, 5), (2, 0, 0), (0, 3, 0))
    black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    scene = mitsuba().load_dict(
        {
            "type": "scene",
            "sheet": mesh_shape(quad((-2, -2, 0), (4, 0, 0), (0, 4, 0)), WHITE),
            "blind": mesh_shape(blind, black),
            "sun": sun_emitter((0.0, 0.0, 1.0), (100.0, 100.0, 100.0)),
        }
    )
    lit = [irradiance_at(scene, (0.0, y, 0.001), DOWN, 2**12, 5)[1] for y in (-0.026, 0.0, 0.026)]
    np.testing.assert_allclose(lit, (100.0, 50.0, 0.0), atol=4.0)


def test_versions_are_read_from_library_names() -> None:
    names = {
        "/usr/lib/x86_64-linux-gnu/libLLVM-14.so.1": 14,
        "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1": 19,
        "/usr/lib64/libLLVM-17.0.6.so": 17,
        "/usr/lib/llvm-18/lib/libLLVM.so": 18,
        "/opt/homebrew/Cellar/llvm/20.1.2/lib/libLLVM.dylib": 20,
        "/opt/own/libLLVM.so": 0,
    }
    assert {name: mitsuba_variants.version_in_name(Path(name)) for name in names} == names


def test_unfit_library_is_found_out_in_a_child_and_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = tmp_path / "libLLVM.so.21.1"
    library.write_bytes(b"no library at all")
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(library))
    monkeypatch.setattr(mitsuba_variants, "PLACES", ())
    asked = []
    run = mitsuba_variants.subprocess.run
    monkeypatch.setattr(mitsuba_variants.subprocess, "run", lambda *a, **k: (asked.append(a), run(*a, **k))[1])
    assert list(mitsuba_variants.candidates()) == [library.resolve()]
    assert mitsuba_variants.usable_library() is None
    assert mitsuba_variants.usable_library() is None
    assert len(asked) == 1


def test_old_libraries_are_not_even_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("libLLVM-14.so.1", "libLLVM-15.so.1", "libLLVM.so.17.0", "libLLVM.so.19.1"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(mitsuba_variants, "PLACES", (str(tmp_path / "*"),))
    assert [path.name for path in mitsuba_variants.candidates()] == ["libLLVM.so.19.1", "libLLVM.so.17.0"]


def test_variant_can_be_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    choose = engines.engine.__wrapped__
    monkeypatch.setenv("DAYLIT_MITSUBA_VARIANT", "scalar_rgb")
    assert choose() == engines.Engine("scalar_rgb", None)
    monkeypatch.setenv("DAYLIT_MITSUBA_VARIANT", "cuda_ad_rgb")
    with pytest.raises(EngineError, match="no renderer is called"):
        choose()
    monkeypatch.setenv("DAYLIT_MITSUBA_VARIANT", "llvm_ad_rgb")
    monkeypatch.setattr(engines, "usable_library", lambda: None)
    with pytest.raises(EngineError, match="no LLVM library"):
        choose()
