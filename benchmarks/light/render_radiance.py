"""Pictures by Radiance (pyradiance): its ambient cache, the window as a secondary source by `mkillum`."""

from __future__ import annotations

import contextlib
import importlib
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.light.render_scenes import emissions_of, triangles_of
from benchmarks.paired import cost_of
from processing.light.scene.scene import Outdoors, Scene
from processing.sphere import Equirectangular, directions

SETTINGS = ("-ab", "5", "-ad", "512", "-as", "128", "-aa", "0.15", "-ar", "64", "-lw", "1e-4")
WINDOW = "#@mkillum d=64 s=64 l+ b=0"
"""Radiance's own advice for windows: directions and samples of each, the light's own distribution kept."""


def radiance_pixels(scene: Scene, eye_m: tuple[float, ...], rays: np.ndarray) -> tuple[np.ndarray, float]:
    """Return what Radiance shows (N, 3) along rays (N, 3), and the CPU seconds of mkillum and rtrace."""
    pr: Any = importlib.import_module("pyradiance")
    # mkillum leaves its distributions in the folder it is called in.
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path(name)
        rad, windows = folder / "room.rad", _windows(scene)
        rad.write_text(_sky(scene.outdoors, folder) + _room(scene))
        octree = folder / "room.oct"
        octree.write_bytes(pr.oconv(str(rad)))
        lines = "\n".join(" ".join(f"{v:.6f}" for v in (*eye_m, *ray)) for ray in rays).encode()
        found: list[bytes] = []

        def all_of_it() -> None:
            if scene.outdoors.rgb.max() > 1:
                illum = folder / "illum.rad"
                illum.write_bytes(pr.mkillum(windows.encode(), octree, params=list(SETTINGS)))
                octree.write_bytes(pr.oconv(str(rad), str(illum)))
            found.append(pr.rtrace(lines, str(octree), inform="a", outform="a", header=False, params=list(SETTINGS)))

        cost = cost_of(all_of_it)
    values = np.array([[float(v) for v in line.split()[:3]] for line in found[0].decode().splitlines() if line.strip()])
    return values, cost.cpu_s


def _room(scene: Scene) -> str:
    text = []
    for number, ((triangles, colour), glow) in enumerate(zip(triangles_of(scene), emissions_of(scene), strict=True)):
        if any(glow):
            text.append(f"void light m{number} 0 0 3 {glow[0]} {glow[1]} {glow[2]}")
        else:
            text.append(f"void plastic m{number} 0 0 5 {colour[0]} {colour[1]} {colour[2]} 0 0")
        text += [f"m{number} polygon p{number}_{k} 0 0 9 {_places(t)}" for k, t in enumerate(triangles)]
    return "\n".join(text) + "\n"


def _windows(scene: Scene) -> str:
    """Return the panes as polygons that face the room."""
    text = [WINDOW]
    for number, pane in enumerate(scene.panes):
        a, b, c = pane.corner_m, pane.across_m, pane.up_m
        corners = np.array([a, a + c, a + c + b, a + b])
        inward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        if inward @ _towards_room(scene, pane.corner_m + (b + c) / 2) < 0:
            corners = corners[::-1]
        text.append(f"void polygon pane{number} 0 0 12 {_places(corners)}")
    return "\n".join(text) + "\n"


def _towards_room(scene: Scene, middle: np.ndarray) -> np.ndarray:
    """Return a direction into the room: that of the wall nearest to a pane."""
    walls = [s for s in scene.surfaces if s.name.startswith("wall")]
    apart = [
        abs((middle - s.origin_m) @ s.normal) + 0.1 * np.linalg.norm(middle - s.world(s.width_m / 2, 0)) for s in walls
    ]
    return np.asarray(walls[int(np.argmin(apart))].normal)


def _sky(outdoors: Outdoors, folder: Path) -> str:
    """Return sky and ground as a picture all around, and the sun as a source."""
    rows = 128
    rays, _ = directions(Equirectangular(2 * rows, rows))
    source = outdoors.rgb
    if source.shape[0] != rows:
        source = np.broadcast_to(source[:1, :1], rays.shape)
    # From the zenith down; columns go round by azimuth, the first once more at the end.
    step = math.pi / rows
    down = f"{step / 2:.9f} {math.pi - step / 2:.9f} {rows}"
    around = f"{step / 2:.9f} {2 * math.pi + step / 2:.9f} {2 * rows + 1}"
    names = []
    for channel, name in enumerate("rgb"):
        values = np.concatenate([source[..., channel], source[:, :1, channel]], axis=1)
        data = folder / f"sky_{name}.dat"
        data.write_text(f"2\n{down}\n{around}\n" + "\n".join(" ".join(f"{v:.6g}" for v in row) for row in values))
        names.append(str(data))
    cal = folder / "sky.cal"
    cal.write_text(
        f"theta = Acos(Dz);\nround(a) = if(a - {step / 2:.9f}, a, a + 2*PI);\nazimuth = round(atan2(Dx, Dy) + PI);\n"
    )
    out = f"void colordata sky 9 red green blue {' '.join(names)} {cal} theta azimuth 0 0\n"
    out += "sky glow even 0 0 4 1 1 1 0\neven source all 0 0 4 0 0 1 360\n"
    sun = outdoors.sun
    if sun is not None:
        level = [v / (math.pi * sun.radius_rad**2) for v in sun.normal_illuminance_lx]
        out += f"void light sun 0 0 3 {level[0]} {level[1]} {level[2]}\n"
        x, y, z = sun.direction
        out += f"sun source disc 0 0 4 {x} {y} {z} {math.degrees(2 * sun.radius_rad)}\n"
    return out


def _places(corners: np.ndarray) -> str:
    return " ".join(f"{v:.6f}" for v in np.asarray(corners).ravel())
