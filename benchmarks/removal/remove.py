"""Removal: near-periodic textures, generated floors, simulated rooms against the truly emptied ones; rivals beside.

``npp_``: the two public textures of NPP-Net's samples, each with its own hole and, in full runs, blobs of 15 and 40 %
(both were looked at while the method was made). ``new_``: patterns that were not: a photographed brick wall, generated
tiles, chequers and herringbone of test seeds. ``rough_``: what does not repeat (photographed gravel and grass,
generated laminate and carpet). Floors one by one: test seeds, lit and in perspective, laid flat. Rooms: test seeds,
furnished against emptied under the same sky; the mask is the true one, 2 pixels wider, with the near shadows.
`room_median_err_pct` holds also what furniture takes from the light of the whole room, which no filling may put back
without changing what is seen; `room_consistent_err_pct` is against the emptied room scaled by what the *unmasked*
pixels of each half lost. ``composed_``: exact truth: the same masks on the emptied rooms themselves, as if furniture
had been put into their pictures and covered with the mask. ``large_``: 2048 x 1024, the rooms whose truth is kept at
that size. `room_seamless_err_pct` is the error of the truth itself, made to join the darker surroundings: what no
filling gets below. `room_edge_sharpness`: steepest step across filled edges of the room over the true one. ``real_``:
furniture rendered into real pictures (`composites`); `real_smooth_err_pct` of means over some pixels, as the
loops of a carpet are nobody's to guess. ``_texture``: the texture distance (`scores`), 0 is alike.
``_gain_db``: over the best rival. Rows are kept (`benchmarks.kept_rows`).
Published figures are quoted in docs/reference/removal.md.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2

from benchmarks.kept_rows import Rows
from benchmarks.removal.composed import composed_real
from benchmarks.removal.patterns import (
    APERIODIC,
    FLOORS,
    PERIODIC,
    SHARES,
    Case,
    compared,
    floor_metrics,
    floors,
    photographs,
    textures,
)
from benchmarks.removal.plot import remove_plot
from benchmarks.removal.rivals import SLOW, rivals
from benchmarks.removal.rooms import full_size_s, plot_cases, rooms

REPEATING = ("near_periodic*", "illumination")
FILLING = ("fill", "plane_fill", "skirting", "plain", "sources", *REPEATING)
"""Of processing/removal: how masks are found does not matter here, and to patterns in the plane no room does."""
SCORES = "benchmarks/removal/scores.py"
CODE = {
    "ours": (*(f"processing/removal/{name}.py" for name in FILLING), "processing/surfaces/*.py", SCORES),
    "patterns": (*(f"processing/removal/{name}.py" for name in REPEATING), SCORES),
    "theirs": ("benchmarks/removal/rivals.py", SCORES),
}
"""Rows of rivals outlast changes of ours."""
UNITS = {"seconds_full": "CPU s"}
Figures = dict[str, float]


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics and rivals; see the module's docstring."""
    cv2.setNumThreads(1)
    others = rivals(slow=not quick)
    rows = Rows("remove", seed, CODE, keep=not quick)
    notes: list[str] = []
    fast = {name: rival for name, rival in others.items() if name not in SLOW}
    metrics: Figures = {}
    found: dict[str, Figures] = {name: {} for name in others}

    def add(part: tuple[Figures, dict[str, Figures]]) -> None:
        metrics.update(part[0])
        for name, figures in part[1].items():
            found[name].update(figures)

    for prefix, cases in _patterns(quick, seed, notes).items():
        # What takes minutes a picture fills the public textures only.
        add(compared(prefix, cases, others if prefix == "npp" else fast, rows))
    metrics.update(floor_metrics(quick, seed, rows))
    add(rooms(quick, seed, others, rows))
    if not quick:
        add(rooms(quick, seed, others, rows, large=True))
    add(composed_real(quick, others, rows, notes))
    metrics["seconds_full"] = rows.row("full size", lambda: full_size_s(quick, seed, notes))
    if not quick:
        remove_plot(plot_cases(seed), fast, Path("removal-time.png"))
    return {"metrics": metrics, "rivals": found, "units": UNITS, "notes": notes}


def _patterns(quick: bool, seed: int, notes: list[str]) -> dict[str, list[Case]]:
    """Return the cases by the prefix of their figures."""
    seen = list(textures(quick))
    if not seen:
        notes.append("no public textures here: near-periodic figures are those of generated tiles")
        seen = list(floors(("tile", "chequered"), SHARES[:1], seed, 1))
    if quick:
        return {"npp": seen}
    made = floors(("tile", "chequered", "herringbone"), SHARES, seed, FLOORS)
    uneven = floors(("laminate", "carpet"), SHARES, seed, FLOORS)
    return {
        "npp": seen,
        "new": [*photographs(PERIODIC, quick), *made],
        "brick": list(photographs(PERIODIC, quick)),
        "rough": [*photographs(APERIODIC, quick), *uneven],
    }
