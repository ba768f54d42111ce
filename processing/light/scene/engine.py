"""Mitsuba, loaded when first needed: which of its variants works on this computer.

An unfit LLVM does not raise, it aborts the process (14 and 15 do on processors with AVX-512). So every library is
tried in a child process first (`engine_probe`), and what was found is kept for this process and in a small file.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from processing.errors import EngineError

SCALAR = "scalar_rgb"
PROBE_LIMIT_S = 90.0
FOLDERS = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt")
PATTERNS = ("*/libLLVM*.so*", "libLLVM*.so*", "llvm-*/lib/libLLVM*.so*", "llvm*/lib/libLLVM*.dylib")
NAMED = "DRJIT_LIBLLVM_PATH"


def libraries() -> list[Path]:
    """Return LLVM libraries to try: the one that the environment names, then the newest first."""
    found = {p.resolve() for folder in FOLDERS for pattern in PATTERNS for p in Path(folder).glob(pattern)}
    newest = sorted((p for p in found if p.is_file()), key=_number, reverse=True)
    named = os.environ.get(NAMED)
    return [Path(named), *(p for p in newest if p != Path(named))] if named else newest


def _number(path: Path) -> tuple[int, ...]:
    digits = "".join(c if c.isdigit() else " " for c in path.name).split()
    return tuple(int(d) for d in digits) or (0,)


@cache
def usable_variant() -> str:
    """Return the fastest variant that works: CUDA, LLVM (the environment then names its library), or scalar."""
    if _works("cuda_ad_rgb", None):
        return "cuda_ad_rgb"
    for library in libraries():
        if _works("llvm_ad_rgb", library):
            os.environ[NAMED] = str(library)
            return "llvm_ad_rgb"
    return SCALAR


def with_variant(variant: str) -> Any:
    """Return the module ``mitsuba`` with this variant set."""
    if variant == "llvm_ad_rgb" and usable_variant() == SCALAR:
        raise EngineError(
            "no LLVM library works here", where=variant, advice="install LLVM 16 or newer (Debian: libllvm19)"
        )
    import mitsuba as mi

    if variant not in mi.variants():
        raise EngineError(f"Mitsuba has no variant {variant!r}", advice=f"one of {', '.join(mi.variants())}")
    mi.set_variant(variant)
    return mi


def _works(variant: str, library: Path | None) -> bool:
    """Return whether a variant renders rightly, tried in a child process."""
    if variant.startswith("cuda") and not Path("/dev/nvidiactl").exists():
        return False
    note = _note(variant, library)
    with suppress(OSError, ValueError, KeyError):
        return bool(json.loads(note.read_text("utf-8"))["works"])
    command = [sys.executable, str(Path(__file__).with_name("engine_probe.py")), variant]
    surroundings = dict(os.environ) | ({NAMED: str(library)} if library else {})
    try:
        done = subprocess.run(command, env=surroundings, capture_output=True, timeout=PROBE_LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        # A busy computer proves nothing: nothing is kept, the next process asks again.
        return False
    with suppress(OSError):
        note.parent.mkdir(parents=True, exist_ok=True)
        draft = note.with_suffix(f".{os.getpid()}")
        draft.write_text(json.dumps({"works": done.returncode == 0, "variant": variant}), "utf-8")
        draft.replace(note)
    return done.returncode == 0


def _note(variant: str, library: Path | None) -> Path:
    from platformdirs import user_cache_path

    when = library.stat().st_mtime_ns if library and library.exists() else 0
    facts = (variant, library, when, version("mitsuba"), version("drjit"), platform.machine(), platform.node())
    digest = hashlib.sha256(repr(facts).encode()).hexdigest()[:16]
    folder = Path(os.environ["DAYLIT_CACHE"]) if os.environ.get("DAYLIT_CACHE") else user_cache_path("daylit")
    return folder / f"renderer-{digest}.json"
