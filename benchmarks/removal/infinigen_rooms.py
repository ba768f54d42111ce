"""Rooms of Infinigen Indoors rendered in Cycles, furnished and truly emptied: a truth that shares nothing with daylit.

Not run by daylit's Python but by that of a virtual environment of its own (Python 3.11), which nothing else needs::

    python3.11 -m venv VENV && VENV/bin/pip install infinigen==1.15.5 bpy==4.2.0
    VENV/bin/python benchmarks/removal/infinigen_rooms.py FOLDER --rooms 12

(The scikit-image that it asks for is compiled; 0.22 does as well and is not: its other requirements first, then
``pip install --no-deps infinigen==1.15.5``.)

``FOLDER``: ``shared/data/infinigen`` beside the checkout, or any, which ``DAYLIT_INFINIGEN`` then names to the
benchmark `emptying`. A room takes a quarter of an hour of one core to make and about six minutes to render. In its
folder:

* ``light-1/``, ``light-2/``: ``furnished.exr`` and ``empty.exr``, linear RGB in one unknown unit, by daylight alone.
  The first light is the sky that Infinigen chose, the second has its sun on the other side of the house.
* ``passes.exr``, ``empty_passes.exr``: distance from the camera (``Depth.Z``, m) and object index (``IndexOB.X``).
* ``room.json``, written last: height of camera and ceiling, m, and what each object index stands for.

Rooms that are there are not made again; one whose making failed or took longer than ``--limit`` is named and left out.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import resource
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

KINDS = ("Bedroom", "LivingRoom", "DiningRoom")
NAMES = {"Bedroom": "bedroom", "LivingRoom": "living-room", "DiningRoom": "dining-room"}  # of floors in a scene
STAYS = ("Window", "Door", "Ceiling", "Blind", "Curtain", "Lamp")  # in the names of assets that emptying leaves
GLOWS = ("Lamp", "CeilingLight")  # they glow by meshes of their own: all out, or the two states differ tenfold
EYE_M = 1.6
CLEAR_M = 0.5  # of the camera to walls and things; chosen
STAYING_INDEX, FIRST_THING = 1, 10
SECOND_SUN = (math.pi, math.radians(30))  # turned by, elevation, rad; chosen


def main() -> None:
    """Make and render rooms, or render one scene (what the first does in a process of its own)."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rooms", type=int, default=12, help="how many; of the kinds in turn")
    parser.add_argument("--seed", type=int, default=11, help="of the first room; the next has the next")
    parser.add_argument("--limit", type=int, default=20, help="CPU minutes for making one room")
    parser.add_argument("--rows", type=int, default=256, help="height of the pictures")
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--threads", type=int, default=1, help="of rendering; making a room has one")
    parser.add_argument("--scene", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--kind", choices=KINDS, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.scene:
        render(asked)
        return
    for seed, kind in zip(range(asked.seed, asked.seed + asked.rooms), itertools.cycle(KINDS), strict=False):
        room = asked.folder / f"{NAMES[kind]}-{seed}"
        if not (room / "room.json").is_file():
            print(room.name, _one(room, kind, seed, asked), flush=True)


def _one(room: Path, kind: str, seed: int, asked: argparse.Namespace) -> str:
    """Make and render one room; return how it went. The scene (200 MB) is deleted."""
    asked.folder.mkdir(parents=True, exist_ok=True)
    log = asked.folder / f"{room.name}.log"
    made = Path(tempfile.mkdtemp(prefix=f".{room.name}-", dir=asked.folder))
    solve = "-g fast_solve.gin singleroom.gin -p compose_indoors.terrain_enabled=False"
    make = ["-m", "infinigen_examples.generate_indoors", "--seed", str(seed), "--task", "coarse"]
    make += ["--output_folder", str(made.resolve()), *solve.split()]
    make += [f'restrict_solving.restrict_parent_rooms=["{kind}"]']
    show = [__file__, str(room.resolve()), "--scene", str(made.resolve() / "scene.blend"), "--kind", kind]
    show += [f"--{name}={getattr(asked, name)}" for name in ("rows", "samples", "threads")]
    try:
        with log.open("w") as out:
            # gin files are looked up from the folder that holds the package
            _call(make, Path(sysconfig.get_paths()["purelib"]), out, 60 * asked.limit)
            _call(show, Path(__file__).resolve().parent, out, None)
    except subprocess.CalledProcessError as error:
        return f"failed ({error}), see {log}"
    finally:
        shutil.rmtree(made, ignore_errors=True)
    log.unlink()
    return "done"


def _call(arguments: list[str], folder: Path, out: Any, limit_s: int | None) -> None:
    def limited() -> None:
        if limit_s:
            resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))

    subprocess.run(
        [sys.executable, *arguments], cwd=folder, stdout=out, stderr=subprocess.STDOUT, check=True, preexec_fn=limited
    )


def render(asked: argparse.Namespace) -> None:
    """Render the ``scene``'s room of a ``kind`` into a ``folder``: passes, then each light emptied and furnished."""
    import bpy

    room, kind = asked.folder, asked.kind
    bpy.ops.wm.open_mainfile(filepath=str(asked.scene))
    things = _sort_out(bpy)
    floor = next(o for o in bpy.data.objects if o.name.startswith(NAMES[kind]) and o.name.endswith(".floor"))
    eye = _stand(bpy, floor, things)
    _settings(bpy, asked.rows, asked.threads)
    room.mkdir(parents=True, exist_ok=True)
    for name, state in (("passes", False), ("empty_passes", True)):
        _shoot(bpy, things, room / f"{name}.exr", empty=state, samples=1, passes=True)
    for light in _lights(bpy):
        for name, state in (("empty", True), ("furnished", False)):  # a pair is there once its furnished picture is
            _shoot(bpy, things, room / light / f"{name}.exr", empty=state, samples=asked.samples)
    known = {
        "camera_height_m": EYE_M,
        "ceiling_m": eye["ceiling_m"],
        "things": {str(one.pass_index): one.name for one in things},
    }
    (room / "room.json").write_text(json.dumps(known, indent=1) + "\n", "utf-8")


def _sort_out(bpy: Any) -> list[Any]:
    """Hide lamps and placeholders, give objects their index, and return the things that emptying takes away."""
    things = []
    for one in bpy.data.objects:
        if "placeholder" in one.name or one.type == "LIGHT" or any(word in one.name for word in GLOWS):
            one.hide_render = True
        elif "spawn_asset" in one.name:
            stays = any(word in one.name for word in STAYS)
            one.pass_index = STAYING_INDEX if stays else FIRST_THING + len(things)
            things += [] if stays else [one]
    return things


def _stand(bpy: Any, floor: Any, things: list[Any]) -> dict[str, float]:
    """Put the camera `EYE_M` above the floor, its +y ahead, as near the middle as walls and things leave it free."""
    import mathutils

    corners = [floor.matrix_world @ mathutils.Vector(corner) for corner in floor.bound_box]
    low, high = ([f(c[i] for c in corners) for i in range(3)] for f in (min, max))
    level, middle = high[2], [(low[i] + high[i]) / 2 for i in (0, 1)]
    inside = _faces_xy(floor)
    boxes = [[one.matrix_world @ mathutils.Vector(corner) for corner in one.bound_box] for one in things]
    tall = [box for box in boxes if max(c.z for c in box) > level + EYE_M - 0.3]
    steps = [(i / 10, j / 10) for i in range(11) for j in range(11)]
    places = [(low[0] + i * (high[0] - low[0]), low[1] + j * (high[1] - low[1])) for i, j in steps]
    around = [(math.cos(a) * CLEAR_M, math.sin(a) * CLEAR_M) for a in (k * math.pi / 4 for k in range(8))]

    def free(x: float, y: float) -> bool:
        if not all(any(_within(x + dx, y + dy, face) for face in inside) for dx, dy in around):
            return False
        return not any(
            min(c.x for c in b) - CLEAR_M < x < max(c.x for c in b) + CLEAR_M
            and min(c.y for c in b) - CLEAR_M < y < max(c.y for c in b) + CLEAR_M
            for b in tall
        )

    ordered = sorted(places, key=lambda p: math.dist(p, middle))
    x, y = next((p for p in ordered if free(*p)), middle)
    data = bpy.data.cameras.new("panorama")
    data.type = "PANO"
    data.panorama_type = "EQUIRECTANGULAR"
    camera = bpy.data.objects.new("panorama", data)
    camera.location, camera.rotation_euler = (x, y, level + EYE_M), (math.pi / 2, 0, 0)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    over = [o for o in bpy.data.objects if o.name == floor.name.replace(".floor", ".ceiling")]
    tops = [(o.matrix_world @ mathutils.Vector(c)).z for o in over for c in o.bound_box]
    return {"ceiling_m": round(min(tops) - level, 3) if tops else 0.0}


def _faces_xy(floor: Any) -> list[list[tuple[float, float]]]:
    """Return the floor's faces seen from above, each its corners in the world, m."""
    place = [floor.matrix_world @ vertex.co for vertex in floor.data.vertices]
    return [[(place[i].x, place[i].y) for i in face.vertices] for face in floor.data.polygons]


def _within(x: float, y: float, face: list[tuple[float, float]]) -> bool:
    inside = False
    for (x0, y0), (x1, y1) in zip(face, face[1:] + face[:1], strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside


def _settings(bpy: Any, rows: int, threads: int) -> None:
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.denoiser = "OPENIMAGEDENOISE"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 2 * rows, rows, 100
    scene.render.use_compositing, scene.use_nodes, scene.render.use_persistent_data = False, False, True
    scene.render.threads_mode, scene.render.threads = "FIXED", threads
    layer = bpy.context.view_layer
    layer.use_pass_z, layer.use_pass_object_index = True, True


def _lights(bpy: Any) -> Iterator[str]:
    """Yield the name of each light while it is set."""
    yield "light-1"
    skies = [n for n in bpy.context.scene.world.node_tree.nodes if n.type == "TEX_SKY"]
    if not skies:
        return
    for sky in skies:
        sky.sun_rotation, sky.sun_elevation = sky.sun_rotation + SECOND_SUN[0], SECOND_SUN[1]
    yield "light-2"


def _shoot(bpy: Any, things: list[Any], path: Path, *, empty: bool, samples: int, passes: bool = False) -> None:
    """Render one picture; where it is of passes, without denoising, its layers by their names."""
    scene = bpy.context.scene
    for one in things:
        one.hide_render = empty
    scene.cycles.samples, scene.cycles.use_denoising = samples, not passes
    scene.render.image_settings.file_format = "OPEN_EXR_MULTILAYER" if passes else "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"  # of that format, which has to be set first
    part = path.with_name(f".{path.name}")
    scene.render.filepath = str(part)
    bpy.ops.render.render(write_still=True)
    part.replace(path)


if __name__ == "__main__":
    main()
