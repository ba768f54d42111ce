"""Compiled kernels: kept by the content of the source, shared by all checkouts of it, and loaded ahead of their use.

Numba keeps what it has compiled beside each source file, by the file's path: every clone would compile all of it anew,
and a change in one file is not seen by kernels of another that call it. `ByContent` (named to Numba by
``processing/__init__.py``) keeps it in the user's cache by the digest of its file and of the kernels
and constants that it imports.

``kernels.json`` lists what `daylit process`, `relight` and moved furniture call, with types, so that `load_kernels` can
compile it while nobody waits; ``python -m benchmarks.whole.kernel_list SESSION PROFILE`` adds to it by doing all that.
"""

import hashlib
import importlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, Self

import numba
from llvmlite.binding import get_host_cpu_features  # type: ignore[import-untyped]
from numba.core.caching import UserProvidedCacheLocator
from platformdirs import user_cache_path

types: Any = importlib.import_module("numba.core.types")
config: Any = importlib.import_module("numba.core.config")
njit: Any = numba.njit  # its types do not know all of its options

# Kernels are compiled for a processor of the last ten years rather than for this one: a wheel's serve everybody, and
# every machine rounds alike.
V3 = ("avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
"""What x86-64-v3 adds to its predecessors (System V ABI, x86-64 psABI, table 3.1), as LLVM calls it."""
_host = get_host_cpu_features()
if all(_host.get(one) for one in V3) and not config.CPU_NAME:
    os.environ["NUMBA_CPU_NAME"], os.environ["NUMBA_CPU_FEATURES"] = "x86-64-v3", ""
    config.reload_config()  # others do that, too: what is set in the module alone is lost then
ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "kernels.json"
SHIPPED = ROOT / "kernels"
"""Where a wheel has kernels compiled when it was built (`studio.build`); copied to the user's cache on first use."""
Described = Any
"""A type as JSON: "float64", {"array": [dtype, dimensions, layout, writable]}, {"tuple": [...]}, {"named": ...}."""

_IMPORTS = re.compile(rb"^from (processing[\w.]*) import (\([^)]*\)|[^\n]*)", re.M)
"""What a file imports when it is loaded; imports within functions are none of a kernel's names."""
_KERNELS = re.compile(rb"numba|^@(compiled|inner|inlined)\b", re.M)


@cache
def _read(path: Path) -> tuple[bytes, bool, frozenset[Path]]:
    """Return a file's digest, whether it has kernels, and which files of ours it may have kernels or constants from."""
    text, found = path.read_bytes(), set()
    for module, listed in _IMPORTS.findall(text):
        place, names = ROOT.parent / module.decode().replace(".", "/"), re.findall(r"\w+", listed.decode())
        files = {one for one in (place.with_suffix(".py"), place / "__init__.py") if one.is_file()}
        files |= {one for name in names if (one := place / f"{name}.py").is_file()}
        constants = any(name.isupper() for name in names)
        found |= {one for one in files if constants or _KERNELS.search(one.read_bytes())}
    return hashlib.sha256(text).digest(), bool(_KERNELS.search(text)), frozenset(found)


@cache
def source_digest(path: Path) -> str:
    """Return the digest of a file, of those with kernels that it imports, and of theirs, and of imported constants."""
    todo, seen = [path], {path}
    while todo:
        _, kernels, imported = _read(todo.pop())
        new = imported - seen if kernels else set()
        todo += new
        seen |= new
    digest = hashlib.sha256()
    for one in sorted(seen):
        digest.update(one.relative_to(ROOT).as_posix().encode() + b"\0" + _read(one)[0])
    return digest.hexdigest()


class ByContent(UserProvidedCacheLocator):
    """Where Numba keeps kernels of this program: by content of the source, not by its place and time."""

    def __init__(self, py_func: Callable[..., Any], py_file: str) -> None:
        super().__init__(py_func, py_file)  # type: ignore[no-untyped-call]
        folder = Path(os.environ["DAYLIT_KERNELS"]) if "DAYLIT_KERNELS" in os.environ else user_cache_path("daylit")
        path = Path(py_file).resolve()
        self._stamp, name = source_digest(path), ".".join(path.relative_to(ROOT).with_suffix("").parts)
        self._cache_path = str(folder / "kernels" / self._stamp[:20] / name)

    def get_source_stamp(self) -> str:
        """Return what a kept kernel must have been made of."""
        return self._stamp

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> Self | None:
        """Return the place of a function; None where it is none of ours, or another folder was asked for."""
        if getattr(config, "CACHE_DIR", "") or not Path(py_file).resolve().is_relative_to(ROOT):
            return None
        place = cls(py_func, py_file)
        path = Path(place._cache_path)
        try:
            if not path.exists() and (shipped := SHIPPED / place._stamp[:20] / path.name).is_dir():
                # So that nobody sees half of it; one that another process made meanwhile stays.
                path.parent.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryDirectory(dir=path.parent) as folder, suppress(OSError):
                    shutil.copytree(shipped, Path(folder, "whole")).rename(path)
            place.ensure_cache_path()  # type: ignore[no-untyped-call]
        except OSError:
            return None
        return place


def compiled(function: Callable[..., Any], **more: Any) -> Any:
    """Compile a function for calls from Python and from other kernels; kept on disk where its cache can be written."""
    settings: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True} | more
    try:
        return njit(cache=True, **settings)(function)
    except RuntimeError:  # numba: no folder for its cache
        return njit(**settings)(function)


inner = partial(compiled, no_cpython_wrapper=True)
"""Compile a function that only kernels call: what would take its arguments from Python need not be compiled."""
inlined = partial(inner, inline="always")
"""The same, but written into its callers: of a function called for each pixel, handing on arrays, each of which is
counted, takes longer than its work (light from small to large picture: 166 to 31 ns a pixel)."""


def load_kernels() -> int:
    """Compile listed kernels that are not cached (the search last), load the rest; return how many were compiled."""
    listed = json.loads(LIST.read_text("utf-8"))
    compiled = 0
    for name, signatures in sorted(listed.items(), key=lambda one: ".layout." in one[0]):
        kernel = _named(name)
        for signature in signatures:
            kernel.compile(tuple(_type(one) for one in signature))
        compiled += sum(kernel.stats.cache_misses.values())
    return compiled


def _named(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def _type(text: Described) -> Any:
    if isinstance(text, str):
        return getattr(types, "boolean" if text == "bool" else text)
    if "array" in text:
        dtype, dimensions, layout, writable = text["array"]
        return types.Array(_type(dtype), dimensions, layout, readonly=not writable)
    parts = [_type(part) for part in text["tuple"]]
    return types.BaseTuple.from_types(parts, _named(text["named"]) if "named" in text else None)
