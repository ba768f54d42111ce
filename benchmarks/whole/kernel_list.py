"""``python -m benchmarks.whole.kernel_list SESSION PROFILE``: process a session that has no results yet, and write
down which kernels that took, for `processing.ground.kernels.load_kernels`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from processing.ground.kernels import LIST, Described, types
from processing.running.requests import RunRequest
from processing.running.runner import process


def main(session: Path, profile: Path) -> int:
    process(session, RunRequest(options={"--calibration": profile}))
    write_list()
    return 0


def write_list() -> None:
    """Write the list anew: the kernels that this process has used, with the types they were called with."""
    found: dict[str, list[list[Described]]] = {}
    for name, kernel in kernels_in_use():
        known = [[described(one) for one in signature] for signature in kernel.signatures]
        if known:
            found[name] = sorted(known, key=json.dumps)
    lines = (f"{json.dumps(name)}: {json.dumps(signatures)}" for name, signatures in sorted(found.items()))
    LIST.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


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
