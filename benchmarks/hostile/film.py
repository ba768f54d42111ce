"""Two brackets of hard films by command: PNG frames, `daylit import`, `daylit process --until merge`.

The two published curves with the least light between their codes 24 and 250, each in all three channels as it was
published; no JPEG, no matrix: what is hard is the curve. Frames of a real HDR scene have the hostile noise and, in the
second, a shutter that is off by a twentieth of a stop. Nothing but frames and the times on the dial is given.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from benchmarks.hostile.two_lenses import WHITE_S, error_of
from benchmarks.hostile.worlds import Curves, HostileBracket, HostileCamera, HostileWorld, hostile_bracket
from processing.ground.arrays import Doubles, Floats
from processing.pictures.exr import read_exr
from processing.pictures.images import RelativeImage

FIRST, LAST = 24, 250
JITTERS = (0.0, 0.05)


def film_figures(curves: Curves, scene: Floats, seed: int) -> dict[str, float]:
    """Return the median error in stops of a scene (H, 2 H, 3), and the least share within the 95 % interval."""
    irradiance, every = curves
    hard = sorted(every, key=lambda shown: _span_stops(irradiance, shown))[: len(JITTERS)]
    errors, covers = [], []
    for number, (shown, jitter) in enumerate(zip(hard, JITTERS, strict=True)):
        camera = HostileCamera(irradiance, np.asarray(shown), seed=seed + number)
        bracket = hostile_bracket(HostileWorld("film", camera, jitter_stops=jitter), scene, WHITE_S, seed + number)
        error, cover = error_of(by_command(bracket), bracket)
        errors.append(error)
        covers.append(cover)
    return {"film_err_stops": float(np.median(errors)), "film_cover95_pct": min(covers)}


def by_command(bracket: HostileBracket) -> RelativeImage:
    """Return what `daylit import` and `daylit process --until merge` make of a bracket's frames, written as PNG."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "frames").mkdir()
        for number, frame in enumerate(bracket.frames):
            assert cv2.imwrite(str(folder / "frames" / f"{number}.png"), frame[..., ::-1])
        times = ",".join(f"{time_s:.9g}" for time_s in bracket.nominal_s)
        _daylit("import", "film", "--indoor", folder / "frames", "--shutter", times, "--into", folder / "sessions")
        [session] = (folder / "sessions").iterdir()
        _daylit("process", session, "--until", "merge")
        picture = read_exr(session / "stages" / "merge" / "indoor.exr")
    assert isinstance(picture, RelativeImage)
    return picture


def _daylit(*asked: object) -> None:
    command = (sys.executable, "-m", "daylit", *map(str, asked), "--json")
    said = subprocess.run(command, capture_output=True, check=False, text=True)
    if said.returncode:
        raise RuntimeError(f"daylit {asked[0]} ended with {said.returncode}: {said.stdout[-400:]} {said.stderr[-400:]}")
    json.loads(said.stdout.splitlines()[-1])


def _span_stops(irradiance: Doubles, shown: Doubles) -> float:
    ends = [[np.interp(code / 255, one, irradiance) for code in (FIRST, LAST)] for one in shown]
    return max(float(np.log2(end / max(start, 1e-4))) for start, end in ends)
