"""The rendering benchmark's own reckoning: time to an error, figures of the race, glass by bouncing rays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from benchmarks.light import render_methods
from benchmarks.light.render import race_figures
from benchmarks.light.render_daylight import HEAD_ON, _glass
from benchmarks.light.render_methods import inverse_tone_curve
from benchmarks.light.render_race import KINDS, race_rooms
from benchmarks.light.render_time import seconds_to
from processing.errors import ParameterError
from processing.light.scene.scene import Material, Part, transmittance_at

ROW = {
    "room": "bedroom-1",
    "kind": "sun",
    "noise": 0.004,
    "ours_2": {"cpu_s": 1.0, "rel": 0.04, "median": 0.01, "bias": 0.002},
    "ours_16": {"cpu_s": 4.0, "rel": 0.02, "median": 0.005, "bias": -0.001},
    "path": {"cpu_s": 10.0, "rel": 0.3, "bias": 0.0},
    "cycles": {"cpu_s": 8.0, "rel": 0.04, "median": 0.01, "bias": 0.0},
}


def test_time_to_an_error_lies_on_the_line_between_two_efforts() -> None:
    assert seconds_to(ROW, 0.04) == pytest.approx(1.0)
    assert seconds_to(ROW, 0.02) == pytest.approx(4.0)
    assert seconds_to(ROW, 0.04 / 2**0.5) == pytest.approx(2.0)
    # Beyond the most effort by the root of time; never less than the least effort.
    assert seconds_to(ROW, 0.01) == pytest.approx(16.0)
    assert seconds_to(ROW, 0.2) == 1.0


def test_the_race_compares_at_equal_error() -> None:
    metrics, rivals = race_figures([ROW])
    assert metrics["equal_error_speedup"] == pytest.approx(10 * 100 / seconds_to(ROW, 0.03), rel=1e-3)
    assert rivals["cycles"]["ratio_it_over_ours"] == pytest.approx(8.0)
    assert "radiance" not in rivals


def test_glass_is_the_sum_of_the_rays_that_bounce_in_it() -> None:
    cosine = np.linspace(0.05, 1, 30)
    ours = transmittance_at(cosine, (HEAD_ON,) * 3, 1)[:, 0]
    # The closed form takes what is absorbed on the straight way only.
    assert ours == pytest.approx(_glass(cosine), abs=0.004)


def test_rooms_of_the_race_have_one_window_each_by_kind() -> None:
    rooms = race_rooms(3, 0)
    assert [room.kind for room in rooms] == list(KINDS)
    sun, overcast, lamps = rooms
    assert len(sun.scene.panes) == len(overcast.scene.panes) == 1
    wide = [float(np.linalg.norm(room.scene.panes[0].across_m)) for room in (sun, overcast)]
    assert wide[0] <= 0.91 < wide[1]
    assert sun.scene.outdoors.sun is not None
    across, up = sun.scene.panes[0].across_m, sun.scene.panes[0].up_m
    middle = sun.scene.panes[0].corner_m + across / 2 + up / 2
    outside = np.cross(across, up) * np.sign(np.cross(across, up) @ middle)
    assert outside @ np.array(sun.scene.outdoors.sun.direction) > 0
    assert any(part.material.emission_cd_m2[0] > 0 for part in lamps.scene.parts)


def test_inverse_tone_curve() -> None:
    found = inverse_tone_curve(np.array([[[0, 128, 255]]], np.uint8), 500.0)
    assert found.ravel() == pytest.approx([0, 500 * (128 / 255) ** 2.2, 500])
    with pytest.raises(ParameterError):
        inverse_tone_curve(np.zeros((1, 1, 3), np.float32), 500.0)


def test_a_shadow_catcher_puts_furniture_over_the_photograph_times_what_is_caught(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    room = race_rooms(1, 0)[0]
    part = Part("box", np.eye(3), np.array([[0, 1, 2]], np.int32), Material("oak", (0.4, 0.3, 0.2), roughness=0.3))
    scene = replace(room.scene, parts=())
    photograph = np.full((2, 4, 3), 50.0, np.float32)

    def cycles(command: list[object], **_: object) -> None:
        given, target, ends = np.load(str(command[2])), Path(str(command[3])), command[4:]
        assert ends == ["8", "2"]  # samples, rows
        assert scene.surfaces[int(given["floor"])].name == "floor"
        assert int(given["shell"]) == len(scene.surfaces) == given["part"].max()
        assert given["triangles"].shape == (len(given["part"]), 3, 3)
        assert (given["colour"][-1], given["rough"][-1]) == (pytest.approx([0.4, 0.3, 0.2]), 0.3)
        assert given["glass"].shape == (2, 3, 3)
        assert 0 < given["sun"][3] <= scene.outdoors.sun.normal_illuminance_lx[0]  # type: ignore[union-attr]
        np.savez(target, cpu_s=3.5)
        front = np.zeros((2, 4, 4), np.float32)
        front[0, 0] = (7, 8, 9, 1)
        noisy, clean = np.ones((2, 4, 3), np.float32), np.full((2, 4, 3), 0.9, np.float32)
        noisy[1, 1] = 0.4
        passes = {"Combined": front, "Noisy Shadow Catcher": noisy, "Shadow Catcher": clean}
        parts = [
            OpenEXR.Part(
                {"type": OpenEXR.scanlineimage},
                {f"Layer.{name}.{c}": np.ascontiguousarray(v[..., k]) for k, c in enumerate("RGBA"[: v.shape[2]])},
                name,
            )
            for name, v in passes.items()
        ]
        OpenEXR.File(parts).write(str(target.with_suffix(".exr")))

    monkeypatch.setenv("DAYLIT_BPY", "python-with-bpy")
    monkeypatch.setattr(render_methods.subprocess, "run", cycles)
    made, cpu_s = render_methods.shadow_catcher(photograph, scene, (part,), room.eye_m, samples=8)
    assert cpu_s == 3.5
    assert made[0, 0] == pytest.approx([7, 8, 9])
    assert made[1, 1] == pytest.approx([45.0] * 3)
    assert (made[1, 2] == 50).all()  # kept where nothing shades, whatever the denoiser says
