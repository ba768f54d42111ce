"""Damaged and hostile OpenEXR files of others: refused by name, within bounds of memory and time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.shared_data import DATA

ROOT = Path(__file__).resolve().parents[3]
CORPUS = DATA / "damaged" / "exr"
WHOLE = {"scanline_with_tiledimage_type.exr"}
"""Read by OpenEXR's own library as a good picture: only the name of its layout is wrong."""

CHILD = """
import json, resource, sys
from pathlib import Path
for limit, value in ((resource.RLIMIT_AS, 4 << 30), (resource.RLIMIT_CPU, 60), (resource.RLIMIT_CORE, 0)):
    resource.setrlimit(limit, (value, value))
from processing.errors import PictureFileError
from processing.pictures.exr import read_exr, read_exr_rgb
import numpy as np
for name in sys.argv[1:]:
    print(json.dumps(["begins", name]), flush=True)
    for read in (read_exr, read_exr_rgb):
        try:
            rgb, _ = read(Path(name))
            answer = "read" if np.isfinite(rgb).all() and rgb.min() >= 0 else "wrong"
        except PictureFileError as error:
            answer = "refused" if Path(name).name in str(error) else "nameless"
        print(json.dumps([read.__name__, answer]), flush=True)
"""


@pytest.mark.shared("damaged/exr")
def test_corpus() -> None:
    files = [p for folder in sorted(CORPUS.iterdir()) if folder.is_dir() for p in sorted(folder.iterdir())]
    files = [p for p in files if p.name != "README.rst"]
    assert len(files) > 80
    done = subprocess.run(
        [sys.executable, "-c", CHILD, *map(str, files)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=300,
        check=False,
    )
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith('["')]
    assert done.returncode == 0, f"died at {lines[-1] if lines else None}: {done.stderr[-500:]}"
    name, answers = "", {}
    for kind, value in lines:
        if kind == "begins":
            name = Path(value).name
        else:
            answers[name, kind] = value
    assert len(answers) == 2 * len(files)
    wrong = {key: value for key, value in answers.items() if value != "refused"}
    assert {key[0] for key in wrong} <= WHOLE, wrong
    assert set(wrong.values()) <= {"read"}
