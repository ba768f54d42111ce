"""Kernels are kept by content and listed by name and types."""

from __future__ import annotations

import ast
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import types

from benchmarks.whole.kernel_list import FROM_KERNELS, SELDOM, described, fields_fit, fits
from processing.ground import kernels
from processing.layout.solver.walk_grid import Grid
from processing.pictures import writing

CODE = """
import os, sys
sys.path.insert(0, sys.argv[1])
import processing.ground.kernels
from processing.room.opening_fit import region
place = region._cache._impl.locator
print(place.get_cache_path(), place.get_source_stamp())
"""


def test_every_kernel_of_the_list_is_one_and_its_types_can_be_made() -> None:
    listed = json.loads(kernels.LIST.read_text("utf-8"))
    assert len(listed) > 20
    for name, signatures in listed.items():
        for signature in signatures:
            assert fits(name, signature), f"{name} has other arguments or fields now (benchmarks.whole.kernel_list)"
            assert [described(kernels._type(one)) for one in signature] == signature, name


def test_entries_that_no_longer_fit_go_from_the_list() -> None:
    walk = {"named": "processing.layout.solver.walk_grid:Grid", "tuple": ["float64", "float64", "float64"]}
    name = "processing.room.opening_fit:region"
    (signature, *_) = json.loads(kernels.LIST.read_text("utf-8"))[name]
    assert fits(name, signature)
    assert not fits(name, signature[1:])
    assert not fits("processing.room.opening_fit:no_longer", signature)
    assert not fits("processing.no_longer:region", signature)
    assert fields_fit(walk)
    assert not fields_fit(walk | {"tuple": ["float64"]})


def test_what_python_calls_is_compiled_ahead() -> None:
    """Of what only kernels call, nothing is listed: those are compiled within their callers."""
    made, called = called_from_python()
    assert len(made) > 60
    assert made - called == FROM_KERNELS, "kernels that Python does not call: `inner`, or FROM_KERNELS where tests do"
    listed = set(json.loads(kernels.LIST.read_text("utf-8")))
    assert called == listed | SELDOM.keys(), "run benchmarks.whole.kernel_list"
    assert not listed & SELDOM.keys()


def called_from_python() -> tuple[set[str], set[str]]:
    """Return all `compiled` functions of the pipeline, and those named outside of kernels, by module and name."""
    files = {".".join(path.relative_to(kernels.ROOT.parent).with_suffix("").parts): path for path in sources()}
    texts = {module: path.read_text("utf-8") for module, path in files.items()}
    trees = {module: ast.parse(text) for module, text in texts.items() if "compiled" in text}
    made = {f"{m}:{one.name}" for m, tree in trees.items() for one in tree.body if "compiled" in decorators(one)}
    one_of_them = re.compile(rf"\b({'|'.join(name.partition(':')[2] for name in made)})\b")
    trees |= {m: ast.parse(text) for m, text in texts.items() if m not in trees and one_of_them.search(text)}
    called: set[str] = set()
    for module, tree in trees.items():
        names = {one.name: f"{module}:{one.name}" for one in tree.body if isinstance(one, ast.FunctionDef)}
        for one in ast.walk(tree):
            if isinstance(one, ast.ImportFrom):
                names |= {alias.asname or alias.name: f"{one.module}:{alias.name}" for alias in one.names}
        called |= {names[name] for name in named_in(tree) if names.get(name) in made}
    return made, called


def sources() -> list[Path]:
    return sorted(kernels.ROOT.rglob("*.py"))


def decorators(node: ast.AST) -> set[str]:
    """Return which kinds of kernel a node is."""
    found = {ast.unparse(one).partition("(")[0] for one in getattr(node, "decorator_list", ())}
    return found & {"compiled", "inner", "inlined"}


def named_in(node: ast.AST) -> set[str]:
    """Return the names that are read within a node, kernels aside."""
    found, todo = set(), [node]
    while todo:
        one = todo.pop()
        if not decorators(one):
            todo += ast.iter_child_nodes(one)
            if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Load):
                found.add(one.id)
    return found


def test_types_are_the_same_after_a_file() -> None:
    named = types.BaseTuple.from_types((types.float64,) * 3, Grid)
    for one in (
        types.boolean,
        types.Array(types.float32, 2, "C"),
        named,
        types.UniTuple(types.int64, 2),
    ):
        assert kernels._type(json.loads(json.dumps(described(one)))) == one
    readonly = types.Array(types.uint8, 1, "A", readonly=True)
    assert kernels._type(described(readonly)).mutable is False


@pytest.mark.long
def test_checkouts_of_the_same_source_share_their_kernels(tmp_path: Path) -> None:
    """The same place for a copy elsewhere with other times; another one once its source differs."""
    copy = tmp_path / "clone"
    ignore = shutil.ignore_patterns("__pycache__", "static", "templates")
    for name in ("processing", "station", "drivers"):
        shutil.copytree(kernels.ROOT.parent / name, copy / name, ignore=ignore, copy_function=shutil.copyfile)
    for other in ("light/solver/upsample.py", "room/wall_views.py"):
        source = copy / "processing" / other
        source.write_text(source.read_text() + "\n")
    ours, theirs = (_place(folder, tmp_path) for folder in (kernels.ROOT.parent, copy))
    assert ours == theirs, "where files differ that this kernel does not use"
    source = copy / "processing" / "room" / "opening_fit.py"
    source.write_text(source.read_text() + "\n")
    assert _place(copy, tmp_path) != ours


def test_a_kernel_is_made_of_what_it_calls_and_of_constants(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernels, "ROOT", tmp_path / "processing")
    texts = {
        "one": "from processing.two import run\nfrom processing.three import (\n    WIDTH,\n    two,\n)\n@compiled\n",
        "two": "import numba\nfrom processing.four import HEIGHT\n",
        "three": "from processing.five import DEPTH\nWIDTH = DEPTH\n",
        "four": "HEIGHT = 1\n",
        "five": "DEPTH = 2\n",
    }
    (tmp_path / "processing").mkdir()
    for name, text in texts.items():
        (tmp_path / "processing" / f"{name}.py").write_text(text)

    def digest() -> str:
        kernels._read.cache_clear()
        kernels.source_digest.cache_clear()
        return kernels.source_digest(tmp_path / "processing" / "one.py")

    last = digest()
    for name, counts in (("two", True), ("three", True), ("four", True), ("five", False)):
        path = tmp_path / "processing" / f"{name}.py"
        path.write_text(path.read_text() + "# changed\n")
        now = digest()
        assert (now != last) == counts, name
        last = now
    kernels._read.cache_clear()
    kernels.source_digest.cache_clear()


def test_every_process_compiles_for_the_same_processor() -> None:
    """As `daylit` begins, with its threads limited: a wheel's kernels are taken wherever x86-64 has AVX2."""
    code = """
from processing.ground.threads import limit_libraries
limit_libraries()
from processing.layout.solver.walk_grid import count_bits
count_bits(3)
import os
import numba
os.environ["NUMBA_NUM_THREADS"] = "1"
numba.config.reload_config()
from numba.core.registry import cpu_target
print(cpu_target.target_context.codegen().magic_tuple()[1])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    features = kernels.get_host_cpu_features()
    portable = all(features.get(one) for one in kernels.V3)
    assert (done.stdout.strip() == "x86-64-v3") == portable


def test_kernels_that_a_wheel_brings_are_copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The folder of this source, whole; what is there already stays."""
    function = writing._round_bits.py_func
    file = function.__code__.co_filename
    monkeypatch.setenv("DAYLIT_KERNELS", str(tmp_path / "user"))
    monkeypatch.setattr(kernels, "SHIPPED", tmp_path / "shipped")
    place = Path(kernels.ByContent(function, file).get_cache_path())
    shipped = tmp_path / "shipped" / place.relative_to(tmp_path / "user" / "kernels")
    shipped.mkdir(parents=True)
    (shipped / "one.nbi").write_bytes(b"compiled elsewhere")
    for _ in range(2):
        found = kernels.ByContent.from_function(function, file)
        assert found is not None
        assert Path(found.get_cache_path()) == place
        assert (place / "one.nbi").read_bytes() == b"compiled elsewhere"
        (shipped / "one.nbi").write_bytes(b"changed")


@pytest.mark.long
def test_what_a_wheel_brings_is_copied_whole_and_not_compiled(tmp_path: Path) -> None:
    """The kernel is loaded from the package's own folder, which stays as it is; another source's is not taken."""
    packages = ("processing", "station", "drivers")
    ignore = shutil.ignore_patterns("static", "templates", "*.onnx")
    for name in packages:
        shutil.copytree(kernels.ROOT.parent / name, tmp_path / name, ignore=ignore)
    shipped = tmp_path / "processing" / "kernels"
    assert _misses(tmp_path, shipped.parent) == "1"
    before = sorted((one, one.stat().st_mtime_ns) for one in shipped.rglob("*"))
    source = tmp_path / "processing" / "ground" / "seam.py"
    source.write_text(source.read_text() + "\n")
    assert _misses(tmp_path, tmp_path / "user") == "0", "which this kernel does not use"
    assert sorted((one, one.stat().st_mtime_ns) for one in shipped.rglob("*")) == before
    source = tmp_path / "processing" / "pictures" / "writing.py"
    source.write_text(source.read_text() + "\n")
    assert _misses(tmp_path, tmp_path / "third") == "1"


def _misses(root: Path, kept: Path) -> str:
    code = """
import sys
sys.path.insert(0, sys.argv[1])
from processing.ground import kernels
kernels.LIST = kernels.ROOT / "one.json"
kernels.LIST.write_text('{"processing.pictures.writing:_round_bits": ' + sys.argv[2] + "}")
print(kernels.load_kernels())
"""
    listed = json.dumps(json.loads(kernels.LIST.read_text("utf-8"))["processing.pictures.writing:_round_bits"])
    return _printed(code, kept, root, str(root), listed)


def _place(root: Path, tmp_path: Path) -> str:
    return _printed(CODE, tmp_path / "kept", tmp_path, str(root))


def _printed(code: str, kept: Path, cwd: Path, *given: str) -> str:
    environment = {"DAYLIT_KERNELS": str(kept), "PATH": "/usr/bin:/bin"}
    command = [sys.executable, "-c", code, *given]
    done = subprocess.run(command, env=environment, cwd=cwd, capture_output=True, text=True, check=True)
    return done.stdout.strip()
