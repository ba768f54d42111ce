"""Which LLVM library Mitsuba can render with on this computer, proven in a child process and remembered on disk.

An unfit LLVM aborts the whole process that uses it (14 and 15 do on processors with AVX-512), so nothing here loads
one: `mocks.rooms.light.llvm_probe` does, as a program of its own.
"""

from __future__ import annotations

import glob
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from mocks.optics.picture_cache import default_folder
from mocks.rooms.light.llvm_probe import OLDEST

PLACES = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib*/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/lib/llvm*/*/lib*/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
    "/usr/local/opt/llvm*/lib/libLLVM*.dylib",
)
"""Debian and Ubuntu, Fedora and Arch, LLVM's own packages, Gentoo, self-built, Homebrew on ARM and Intel."""

PROBE_LIMIT_S = 60.0


def usable_library() -> Path | None:
    """Return the newest LLVM library that renders here: the one in ``DRJIT_LIBLLVM_PATH`` first, if it does."""
    return next((path for path in candidates() if _proven(path)), None)


def candidates() -> Iterator[Path]:
    """Yield the libraries that may do, each once: the one the environment names, then the newest first."""
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    found = [Path(p) for pattern in PLACES for p in glob.glob(pattern)]  # noqa: PTH207 (patterns are absolute)
    found.sort(key=lambda path: (version_in_name(path), str(path)), reverse=True)
    seen = set()
    for path in ([Path(named)] if named else []) + found:
        real = path.resolve()
        if real not in seen and real.is_file() and not 0 < version_in_name(real) < OLDEST:
            seen.add(real)
            yield real


def version_in_name(path: Path) -> int:
    """Return the major version that a library's path tells (libLLVM.so.19.1, llvm-19/, llvm/19.1.7/), else 0."""
    in_file = re.search(r"libLLVM-?(?:\.so\.)?(\d+)", path.name)
    in_folder = re.search(r"/llvm(?:@\d+)?[-/]?(\d+)", path.as_posix())
    found = in_file or in_folder
    return int(found.group(1)) if found else 0


def _proven(library: Path) -> bool:
    """Return whether the library renders here; asked once, as long as library, Mitsuba and processor stay the same."""
    facts = (library, library.stat().st_mtime_ns, version("mitsuba"), version("drjit"), _processor())
    digest = hashlib.sha256("\x1f".join(str(fact) for fact in facts).encode()).hexdigest()[:16]
    note = default_folder().parent / f"llvm-{digest}.json"
    with suppress(OSError, ValueError, KeyError):
        return bool(json.loads(note.read_text("utf-8"))["usable"])
    try:
        probe = [sys.executable, str(Path(__file__).with_name("llvm_probe.py")), str(library)]
        usable = subprocess.run(probe, capture_output=True, timeout=PROBE_LIMIT_S, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        # A busy computer is no fault of the library: ask again next time.
        return False
    _write(note, json.dumps({"library": str(library), "usable": usable}))
    return usable


def _write(path: Path, text: str) -> None:
    """Write a note in one step; where nothing can be written, the next process asks anew."""
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
        os.write(handle, text.encode())
        os.close(handle)
        Path(name).replace(path)


def _processor() -> str:
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
    return f"{platform.machine()} {platform.processor()}"
