"""Who may import whom: the house's walls (docs/architecture.md)."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OURS = ("drivers", "mocks", "station", "processing", "tests", "benchmarks", "training", "daylit")

ALLOWED: dict[str, tuple[str, ...]] = {
    "drivers": ("drivers",),
    "mocks": ("mocks", "drivers.ptp", "drivers.errors", "drivers.clock"),
    "station": ("station", "drivers"),
    "processing": (
        "processing",
        "drivers.errors",
        "drivers.clock",
        "station.session.session",
        "station.session.store",
        "station.errors",
        "station.session.verify",
        "station.session.durable",
        "station.session.folder",
        "station.session.lock",
        "station.session.strict_json",
    ),
}
BASE = (
    *("errors", "sphere", "resampling", "views", "images", "frames"),
    *("image_files", "exr_", "radiance_", "picture_", "false_colour"),
    *("segmentation", "surfaces"),
)
"""Of processing: what every room of the house may use; a name covers the files that start with it (`sphere_maps`)."""
ROOMS = ("calibration", "room", "removal", "layout", "rendering")
"""Of equal rank: none imports another, but the small types of `room.model`."""
TOP = 5
"""The rank of what may import all of processing: pipeline, running, commands."""
MOCKS_MAY_SHARE_OF_PTP = ("drivers.ptp.codes", "drivers.canon_5d2.codes", "drivers.theta_z1.codes")
ONLY_IN = {
    "serial": ("drivers/serial_link.py",),
    "usb": ("drivers/usb_link.py", "mocks/instruments/usb/bus.py", "mocks/instruments/usb/descriptors.py"),
    "libusb_package": ("drivers/usb_link.py",),
    "click": ("station/commands/", "processing/commands/", "daylit.py"),
    "rich": ("station/commands/", "processing/commands/"),
    "numba": (
        *("processing/calibration/", "processing/sphere_", "processing/layout/"),
        *("processing/surfaces/", "processing/removal/", "processing/room/", "processing/rendering/"),
    ),
    "simplejpeg": ("processing/pictures/frames.py", "processing/frames_"),
    "colour": ("processing/calibration/",),
    "matplotlib": ("processing/report/",),
    "jinja2": ("processing/report/",),
    "mitsuba": ("mocks/rooms/light/engine.py", "mocks/rooms/light/llvm_probe.py", "processing/rendering/"),
    "drjit": ("mocks/rooms/light/engine.py", "mocks/rooms/light/llvm_probe.py", "processing/rendering/"),
    "embreex": ("mocks/rooms/light/geometry.py", "processing/rendering/"),
    "pyoidn": ("mocks/rooms/light/light.py", "processing/rendering/"),
    "onnxruntime": ("processing/segmentation/",),
    "ai_edge_litert": ("processing/segmentation/",),
    "distributed": ("processing/batch/",),
    "dask": ("processing/batch/",),
    "trimesh": ("processing/layout/", "processing/rendering/", "processing/room/"),
    "pvlib": ("mocks/rooms/sky/moment.py", "processing/calibration/"),
    "pandas": ("mocks/rooms/sky/moment.py", "processing/calibration/"),
    "shapely": (
        "mocks/rooms/plan_",
        "mocks/rooms/shell_",
        "mocks/rooms/furnish_",
        "mocks/rooms/truth.py",
        "processing/layout/",
        "processing/room/",
        "processing/surfaces/",
    ),
}
BINDS_BOTH = ("processing/commands/demo.py",)
"""Commands that run the station and then processing."""
FRONT_DOOR_ANEW = "processing/batch/child.py"
"""The program of its own in which a batch runs each session: it is the command line, begun once more."""
LIGHT_AT_IMPORT = ("station.capture.events", "processing.commands.process")
"""What command modules may import at once: a plain list of names, and another command module (checked likewise)."""
MOCKS_FROM_STATION = ("station/capture/rig.py", "station/simulate/")


def python_files(*folders: str) -> Iterator[Path]:
    for folder in folders:
        yield from sorted((ROOT / folder).rglob("*.py"))


@cache
def imports(path: Path) -> tuple[tuple[str, ast.stmt, bool], ...]:
    """Return (module, statement, only for type checkers) of each import of a file."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[tuple[str, ast.stmt, bool]]:
    tree = ast.parse(path.read_text("utf-8"))
    typing_only = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                yield name.name, node, id(node) in typing_only
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            base = node.module or ""
            for name in node.names:
                full = f"{base}.{name.name}"
                target = full if (ROOT / Path(*full.split("."))).with_suffix(".py").exists() else base
                yield target, node, id(node) in typing_only


def within(module: str, allowed: tuple[str, ...]) -> bool:
    return any(module == a or module.startswith(a + ".") for a in allowed)


@pytest.mark.parametrize("package", sorted(ALLOWED))
def test_imports_go_one_way(package: str) -> None:
    wrong = []
    for path in python_files(package):
        where = path.relative_to(ROOT).as_posix()
        for module, node, typing_only in imports(path):
            if module.split(".")[0] not in OURS or within(module, ALLOWED[package]):
                continue
            lazily = typing_only or node.col_offset > 0
            if where == FRONT_DOOR_ANEW and module == "daylit" and lazily:
                continue
            if where in BINDS_BOTH and module.startswith("station") and lazily:
                continue
            if where.startswith(MOCKS_FROM_STATION) and module.startswith("mocks") and lazily:
                continue
            wrong.append(f"{where}:{node.lineno} imports {module}")
    assert not wrong, "\n".join(wrong)


def rank(path: Path) -> int:
    """Return how high a module of processing stands; it may import what is lower, and its own folder."""
    parts = path.relative_to(ROOT / "processing").with_suffix("").parts
    if parts[0].startswith(BASE):
        return 0
    if parts[0] in ROOMS:
        return 1
    return {"exchange": 2, "light_figures": 2, "stages": 3, "report": 4}.get(parts[0], TOP)


def test_inside_processing_imports_go_one_way() -> None:
    wrong = []
    for path in python_files("processing"):
        for module, node, typing_only in imports(path):
            target = (ROOT / Path(*module.split("."))).with_suffix(".py")
            if not module.startswith("processing.") or typing_only or not target.exists():
                continue
            same = target.relative_to(ROOT).parts[1] == path.relative_to(ROOT).parts[1]
            if same or rank(path) == TOP or module == "processing.room.model":
                continue
            if rank(target) > rank(path) or rank(target) == rank(path) > 0:
                wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_on_site_nothing_imports_what_makes_data_sets() -> None:
    wrong = [
        f"{path.name}: {module}"
        for path in python_files("drivers", "station")
        for module, _, _ in imports(path)
        if module.startswith("station.simulate")
        and path.parent.name != "simulate"
        and path != ROOT / "station" / "commands" / "simulate.py"
    ]
    assert not wrong, wrong


def test_mocks_share_only_code_tables_with_the_drivers() -> None:
    wrong = [
        f"{path.name}: {module}"
        for path in python_files("mocks")
        for module, _, _ in imports(path)
        if module.startswith("drivers.ptp") and module not in MOCKS_MAY_SHARE_OF_PTP
    ]
    assert not wrong, wrong


@pytest.mark.parametrize("library", sorted(ONLY_IN))
def test_library_stays_in_its_place(library: str) -> None:
    wrong = []
    for path in (*python_files("drivers", "mocks", "station", "processing"), ROOT / "daylit.py"):
        where = path.relative_to(ROOT).as_posix()
        places = ONLY_IN[library]
        if where in places or where.startswith(tuple(place for place in places if place.endswith(("/", "_")))):
            continue
        wrong += [f"{where}:{n.lineno}" for module, n, _ in imports(path) if module.split(".")[0] == library]
    assert not wrong, f"{library} is imported in {wrong}"


def test_front_door_and_command_modules_import_nothing_heavy() -> None:
    light = {"click", "station", "processing", "drivers", *sys.stdlib_module_names}
    wrong = []
    for path in (ROOT / "daylit.py", *python_files("station/commands", "processing/commands")):
        for module, node, typing_only in imports(path):
            top_level = node.col_offset == 0 and not typing_only
            if top_level and module.split(".")[0] not in light:
                wrong.append(f"{path.name}:{node.lineno} {module}")
            if top_level and module.startswith(("station", "processing", "drivers")) and module not in LIGHT_AT_IMPORT:
                wrong.append(f"{path.name}:{node.lineno} {module} at import time")
    assert not wrong, wrong
