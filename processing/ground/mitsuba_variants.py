"""Mitsuba, loaded when first needed: which of its variants works on this computer, and with which LLVM library.

An unfit LLVM does not raise, it aborts the whole process that uses it (14 and 15 do on processors with AVX-512). So
every library is tried in a child process first: this file, run as a program with a variant and a library. What was
found is remembered on disk as long as library, Mitsuba and processor stay the same.
"""

import ctypes
import glob
import hashlib
import importlib
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from processing.errors import EngineError

SCALAR, LLVM, CUDA = "scalar_rgb", "llvm_ad_rgb", "cuda_ad_rgb"
OLDEST = 16  # LLVM 14 and 15 abort with 'Cannot select' on processors with AVX-512
ENVIRONMENT = "DRJIT_LIBLLVM_PATH"  # where Dr.Jit looks for its library when it is first used
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
PROBE_LIMIT_S = 90.0  # chosen: a first render takes 2 to 5 s on an idle computer
TOLERANCE = 0.02  # of the probe's radiance; chosen: eight times its noise


def load_mitsuba(variant: str) -> Any:
    """Return the module ``mitsuba`` with a variant set; for `LLVM` there must be a `usable_library`.

    Raises `EngineError` where a library of the system that it is built on is missing.
    """
    if variant == LLVM and (library := usable_library()):
        os.environ[ENVIRONMENT] = str(library)
    try:
        mi: Any = importlib.import_module("mitsuba")
    except (ImportError, NameError) as error:
        # Dr.Jit 1.4 fails with a NameError of its own while it words the ImportError that says what is missing.
        why = error.__context__ if isinstance(error, NameError) else error
        likely = "a system without GCC's libatomic, such as a minimal Debian image"
        advice = "install it (Debian and Ubuntu: `apt install libatomic1`)"
        raise EngineError(f"Mitsuba cannot be loaded: {why}", where="mitsuba", likely=likely, advice=advice) from error
    mi.set_variant(variant)
    return mi


@cache
def usable_variant() -> str:
    """Return the fastest variant that works: CUDA, LLVM, else scalar, which works everywhere."""
    if Path("/dev/nvidiactl").exists() and _works(CUDA, None):
        return CUDA
    return LLVM if usable_library() else SCALAR


def usable_library() -> Path | None:
    """Return the newest LLVM library that renders here: the one that the environment names first, if it does."""
    return next((path for path in candidates() if _works(LLVM, path)), None)


def candidates() -> Iterator[Path]:
    """Yield the libraries that may do, each once: the one that the environment names, then the newest first."""
    named = os.environ.get(ENVIRONMENT)
    installed = [Path(p) for pattern in PLACES for p in glob.glob(pattern)]  # noqa: PTH207 (patterns are absolute)
    installed.sort(key=lambda path: (version_in_name(path), str(path)), reverse=True)
    seen = set()
    for path in ([Path(named)] if named else []) + installed:
        real = path.resolve()
        if real not in seen and real.is_file() and not 0 < version_in_name(real) < OLDEST:
            seen.add(real)
            yield real


def version_in_name(path: Path) -> int:
    """Return the major version in a library's path (libLLVM.so.19.1, llvm-19/, llvm/19.1.7/), else 0."""
    in_file = re.search(r"libLLVM-?(?:\.so\.)?(\d+)", path.name)
    version = in_file or re.search(r"/llvm(?:@\d+)?[-/]?(\d+)", path.as_posix())
    return int(version.group(1)) if version else 0


def _works(variant: str, library: Path | None) -> bool:
    """Return whether a variant renders rightly, from the note of an earlier trial or by a new one."""
    note = _note(variant, library)
    with suppress(OSError, ValueError, KeyError):
        return bool(json.loads(note.read_text("utf-8"))["works"])
    probe = [sys.executable, __file__, variant, str(library or "")]
    try:
        works = subprocess.run(probe, capture_output=True, timeout=PROBE_LIMIT_S, check=False).returncode == 0
    except subprocess.TimeoutExpired:
        # A busy computer is no fault of the library: nothing is kept, the next process tries again.
        return False
    with suppress(OSError):
        note.parent.mkdir(parents=True, exist_ok=True)
        handle, draft = tempfile.mkstemp(dir=note.parent, suffix=".part")
        with os.fdopen(handle, "w") as file:
            json.dump({"variant": variant, "library": str(library), "works": works}, file)
        Path(draft).replace(note)
    return works


def _note(variant: str, library: Path | None) -> Path:
    from importlib.metadata import version

    from platformdirs import user_cache_path

    modified = library.stat().st_mtime_ns if library else 0
    facts = (variant, library, modified, version("mitsuba"), version("drjit"), _processor())
    digest = hashlib.sha256("\x1f".join(str(fact) for fact in facts).encode()).hexdigest()[:16]
    folder = Path(os.environ["DAYLIT_CACHE"]) if os.environ.get("DAYLIT_CACHE") else user_cache_path("daylit")
    return folder / f"mitsuba-{digest}.json"


def _processor() -> str:
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        return "\n".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
    return f"{platform.machine()} {platform.processor()}"


def probe(variant: str, library: str) -> str:
    """Render a white square under a uniform sky of radiance 1 and return what is wrong, or nothing; for a child."""
    if library:
        if _library_version(library) < OLDEST:
            return f"LLVM is older than {OLDEST}"
        os.environ[ENVIRONMENT] = library
    import numpy as np

    mi: Any = importlib.import_module("mitsuba")
    mi.set_variant(variant)
    sky = mi.Bitmap(np.ones((4, 8, 3), dtype=np.float32))
    white = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}
    sensor = {
        "type": "perspective",
        "fov": 30.0,
        "to_world": mi.ScalarTransform4f().look_at([0, 0, 4], [0, 0, 0], [0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 8, "height": 8, "rfilter": {"type": "box"}},
    }
    scene = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 8},
        "sensor": sensor,
        "sky": {"type": "envmap", "bitmap": sky},
        "square": {"type": "rectangle", "bsdf": white},
    }
    mean = float(np.array(mi.render(mi.load_dict(scene), spp=16, seed=1)).mean())
    return "" if abs(mean - 1.0) <= TOLERANCE else f"a white square under a white sky shines at {mean:.3f}"


def _library_version(path: str) -> int:
    """Return the library's major version, 0 where it is older than 16 (which cannot say) or cannot be loaded."""
    try:
        ask = ctypes.CDLL(path).LLVMGetVersion
    except (OSError, AttributeError):
        return 0
    major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
    ask(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
    return int(major.value)


if __name__ == "__main__":
    sys.exit(probe(*sys.argv[1:]) or 0)
