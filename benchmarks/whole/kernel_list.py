"""``python -m benchmarks.whole.kernel_list SESSION PROFILE``: process a session that has no results yet, relight it,
move its furniture, arrange more than it holds, merge raw frames, and write down which kernels that took, for
`processing.ground.kernels.load_kernels`. The session is best a copy: it keeps what it was last asked.

What was written down before and was not met this time stays as long as it `fits`: no session meets everything. With
``{}`` as the list it is written from nothing.
"""

from __future__ import annotations

import importlib
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import daylit
from benchmarks.hostile.worlds import HostileCamera, HostileWorld, hostile_bracket
from processing.ground.kernels import LIST, Described, types
from processing.layout.arrangement import Arrangements
from processing.relighting.live_furniture import LiveFurniture, style_of

FREE_SETS = "add_forbidden add_walls complement merged rects_inside"
WALK_GRID = "connected count_bits lowest rect_distance2 spread touches"
FROM_KERNELS = {
    *(f"processing.layout.solver.free_sets:{name}" for name in FREE_SETS.split()),
    *(f"processing.layout.solver.walk_grid:{name}" for name in WALK_GRID.split()),
}
"""Called by kernels and by tests alone: within those they are compiled with them, so that nobody waits for them by
themselves. As `inner` kernels tests could not call them."""
SELDOM = {
    "processing.layout.solver.walk_grid:stamp": "a plan with bodies that stand fast",
    "processing.room.opening_fit:edge": "a window under a blind",
    "processing.sphere.overlap:scatter": "a panorama whose size the target's does not divide",
}
"""What needs kernels that the list does without, as `main` does not meet it: each takes two seconds at most."""
MORE = "3 bed, 3 wardrobe, 3 desk, 3 sofa"
"""Than a small room holds: for what is left over, all places are looked through."""


def main(session: Path, profile: Path) -> int:
    """Do all of that; see above."""
    with tempfile.TemporaryDirectory() as folder:
        merge_raw(Path(folder))
    run("process", session, "--calibration", profile)
    run("relight", session, "--at", "2023-06-21 16:00", "--site", "40.44,-79.99", "--heading", 0, "--rows", 128)
    found = (session / "stages" / "arrange" / "arrangement.json").read_text("utf-8")
    items = Arrangements.model_validate_json(found).arrangements[0].items
    live, style = LiveFurniture(session), style_of(session)
    for few in (items[:1], items):
        live.staged(few, style)
    run("process", session, "--until", "arrange", "--items", MORE)
    write_list()
    return 0


def run(*words: object) -> None:
    """Run a command of the program in this process; `RuntimeError` where it fails."""
    if daylit.main([str(word) for word in words]) not in (0, None):
        raise RuntimeError(f"daylit {words[0]} failed")


def merge_raw(folder: Path) -> None:
    """Merge a bracket of small DNGs."""
    codes = np.linspace(0, 1, 256)
    light = np.exp(np.random.default_rng(3).uniform(0, 9, (192, 384, 3))).astype(np.float32)
    world = HostileWorld("raw", HostileCamera(codes, np.stack([codes] * 3), mosaic=True))
    for number, data in enumerate(hostile_bracket(world, light, 20.0, 900_004, raw=True).raw):
        (folder / f"{number}.dng").write_bytes(data)
    run("import", "raw", "--indoor", folder, "--into", folder / "sessions")
    run("process", *(folder / "sessions").glob("*raw*"), "--until", "merge")


def write_list() -> None:
    """Add to the list the kernels that this process has used, with the types they were called with."""
    before: dict[str, list[list[Described]]] = json.loads(LIST.read_text("utf-8"))
    found = {name: kept for name, every in before.items() if (kept := [one for one in every if fits(name, one)])}
    for name, kernel in kernels_in_use():
        known = [[described(one) for one in signature] for signature in kernel.signatures]
        if known and name not in FROM_KERNELS:
            known += [one for one in found.get(name, []) if one not in known]
            found[name] = sorted(known, key=json.dumps)
    lines = (f"{json.dumps(name)}: {json.dumps(signatures)}" for name, signatures in sorted(found.items()))
    LIST.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def fits(name: str, signature: list[Described]) -> bool:
    """Return whether there is still such a kernel, with as many arguments, and tuples with as many fields."""
    try:
        kernel = kernel_named(name)
    except (ImportError, AttributeError):
        return False
    return len(signature) == kernel.py_func.__code__.co_argcount and fields_fit(signature)


def kernel_named(name: str) -> Any:
    """Return what is called MODULE:NAME; raises `ImportError` and `AttributeError`."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def fields_fit(one: Described) -> bool:
    """Return whether every NamedTuple within a type, or a list of them, has the fields that it had."""
    parts = one.get("tuple", []) if isinstance(one, dict) else one
    named = one.get("named") if isinstance(one, dict) else None
    whole = named is None or len(kernel_named(named)._fields) == len(parts)
    return whole and (not isinstance(parts, list) or all(map(fields_fit, parts)))


def kernels_in_use() -> Iterator[tuple[str, Any]]:
    """Yield the kernels of the modules that are loaded, by name."""
    for module in sorted(name for name in sys.modules if name.startswith("processing.")):
        for attribute, value in sorted(vars(sys.modules[module]).items()):
            if hasattr(value, "signatures") and hasattr(value, "py_func") and value.py_func.__module__ == module:
                yield f"{module}:{attribute}", value


def described(one: Any) -> Described:
    """Return a Numba type as JSON."""
    if isinstance(one, types.Array):
        return {"array": [str(one.dtype), one.ndim, one.layout, bool(one.mutable)]}
    if isinstance(one, types.NamedTuple | types.NamedUniTuple):
        made = one.instance_class
        return {"named": f"{made.__module__}:{made.__qualname__}", "tuple": [described(part) for part in one.types]}
    if isinstance(one, types.BaseTuple):
        return {"tuple": [described(part) for part in one.types]}
    return str(one)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
