"""Who may import whom: the house's walls (docs/reference/architecture.md)."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tests.architecture.sources import nodes_of

ROOT = Path(__file__).resolve().parents[2]
OURS = ("drivers", "mocks", "station", "processing", "studio", "tests", "benchmarks", "training", "daylit")

ALLOWED: dict[str, tuple[str, ...]] = {
    "drivers": ("drivers",),
    "mocks": (
        *("mocks", "drivers.errors", "drivers.clock", "processing.ground"),
        *("drivers.ptp.codes", "drivers.canon_5d2.codes", "drivers.theta_z1.codes"),
    ),
    "station": ("station", "drivers"),
    "processing": (
        *("processing", "drivers.errors", "drivers.clock", "station.session", "station.errors"),
        "station.commands.views",  # how commands show their progress: all of them alike
    ),
    "studio": ("studio", "processing", "station", "drivers.errors", "daylit"),
}
FLOORS = (
    ("errors",),
    ("ground",),
    ("sphere", "pictures", "segmentation", "surfaces"),
    ("calibration", "room", "removal", "layout", "light"),
    ("exchange", "figures"),
    ("stages",),
    ("report",),
)
"""The floors of processing from below; what is in none of them (pipeline, running, commands) may import everything."""
SHARES_A_FLOOR = 2
"""The one floor whose rooms know each other; what they share with others is on the ground."""
ONLY_IN = {
    "serial": ("drivers/serial_link.py",),
    "usb": ("drivers/usb_link.py", "mocks/instruments/usb/"),
    "libusb_package": ("drivers/usb_link.py",),
    "click": ("station/commands/", "processing/commands/", "studio/command.py", "daylit.py"),
    "rich": ("station/commands/", "processing/commands/"),
    "numba": (
        *("processing/ground/", "processing/sphere/", "processing/surfaces/", "processing/calibration/"),
        *("processing/room/", "processing/removal/", "processing/layout/", "processing/light/"),
    ),
    "simplejpeg": ("processing/pictures/frames.py",),
    "colour": ("processing/ground/", "processing/calibration/"),
    "matplotlib": ("processing/report/", "processing/layout/drawn/"),
    "jinja2": ("processing/report/",),
    "mitsuba": ("mocks/rooms/light/", "processing/ground/", "processing/light/"),
    "drjit": ("mocks/rooms/light/", "processing/ground/", "processing/light/"),
    "embreex": ("mocks/rooms/light/", "processing/layout/drawn/", "processing/light/"),
    "pyoidn": ("mocks/rooms/light/", "processing/light/"),
    "onnxruntime": ("processing/segmentation/",),
    "ai_edge_litert": ("processing/segmentation/",),
    "pooch": ("processing/segmentation/installed.py",),
    "starlette": ("studio/",),
    "uvicorn": ("studio/",),
    "distributed": ("processing/batch/",),
    "dask": ("processing/batch/",),
    "trimesh": ("processing/layout/", "processing/light/", "processing/room/"),
    "pvlib": ("mocks/rooms/sky/", "processing/calibration/"),
    "pandas": ("mocks/rooms/sky/", "processing/calibration/"),
    "shapely": (
        *("mocks/rooms/plan/", "mocks/rooms/shell/", "mocks/rooms/furnish/", "mocks/rooms/truth.py"),
        *("processing/ground/", "processing/layout/", "processing/room/", "processing/surfaces/"),
    ),
}
BINDS_BOTH = ("processing/commands/demo.py", "processing/api.py")
"""What runs the station and then processing: a command, and the public functions."""
FRONT_DOOR_ANEW = "processing/batch/work.py"
"""A batch runs each session in a program of its own: the command line, begun once more."""
LIGHT_AT_IMPORT = ("station.capture.events", "station.commands.views", "processing.commands.process")
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
    typing_only = {
        id(inner)
        for node in nodes_of(path)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    for node in nodes_of(path):
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


def floor(path: Path) -> int:
    """Return the floor of a module of processing; it may import what is below it, and its own room."""
    room = path.relative_to(ROOT / "processing").with_suffix("").parts[0]
    return next((k for k, rooms in enumerate(FLOORS) if room in rooms), len(FLOORS))


def test_inside_processing_imports_go_one_way() -> None:
    wrong = []
    for path in python_files("processing"):
        for module, node, typing_only in imports(path):
            target = (ROOT / Path(*module.split("."))).with_suffix(".py")
            if not target.exists():
                target = ROOT / Path(*module.split(".")) / "__init__.py"
            if not module.startswith("processing.") or typing_only or not target.exists():
                continue
            same = target.relative_to(ROOT).parts[1] == path.relative_to(ROOT).parts[1]
            if same or floor(path) == len(FLOORS) or (module == "processing.ground.room_model" and floor(path) > 1):
                continue
            if floor(target) > floor(path) or floor(target) == floor(path) != SHARES_A_FLOOR:
                wrong.append(f"{path.relative_to(ROOT)}:{node.lineno} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_the_ground_uses_no_room() -> None:
    allowed = ("processing.ground", "processing.errors", "drivers.errors", "station.session", "station.errors")
    wrong = [
        f"{path.name}: {module}"
        for path in python_files("processing/ground")
        for module, _, _ in imports(path)
        if module.split(".")[0] in OURS and not within(module, allowed)
    ]
    assert not wrong, wrong


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


@pytest.mark.parametrize("library", sorted(ONLY_IN))
def test_library_stays_in_its_place(library: str) -> None:
    wrong = []
    for path in (*python_files("drivers", "mocks", "station", "processing", "studio"), ROOT / "daylit.py"):
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
