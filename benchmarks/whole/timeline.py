"""``python -m benchmarks.whole.timeline FILE``: one full simulated capture as a picture, from the cameras' own logs."""

from __future__ import annotations

import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

COLOURS = {"exposure": "#d98e04", "transfer": "#2a6f97", "reading": "#6a994e"}


def record() -> tuple[dict[str, list[tuple[float, float]]], float]:
    """Capture once and return the bars of each lane (start, length; seconds) and the total."""
    from mocks.instruments.bench import make_bench
    from station.capture.capture import Capture, CaptureRequest
    from station.capture.rig import open_simulated_rig, wanted_cameras
    from station.capture.rig_file import PAPER_RIG

    bench = make_bench("room", wanted_cameras(PAPER_RIG), PAPER_RIG.bracket.stops_s())
    rig = open_simulated_rig(PAPER_RIG, bench)
    lanes: dict[str, list[tuple[float, float]]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        job = Capture.new(rig, CaptureRequest(room="timeline", into=Path(folder)))
        begin_s = rig.clock.monotonic_s()
        last: dict[str, float] = {}
        for event in job.events():
            _note(lanes, last, event, begin_s)
        end_s = rig.clock.monotonic_s() - begin_s
        job.store.close()
    for side, kind in (("indoor", "theta_z1"), ("outdoor", "canon_5d2")):
        lanes[f"{side} exposure"] = [
            (e.start_s - begin_s, max(e.end_s - e.start_s, 0.08)) for e in bench.cameras[kind].exposure_log
        ]
    rig.close()
    return lanes, end_s


def _note(lanes: dict[str, list[tuple[float, float]]], last: dict[str, float], event: Any, begin_s: float) -> None:
    at_s = event.at_s - begin_s
    if event.kind == "progress":
        side = event.data["side"]
        length_s = min(0.06, at_s - last.get(side, at_s - 0.06))
        lanes[f"{side} transfer"].append((at_s - length_s, length_s))
        last[side] = at_s
    elif event.kind == "reading":
        taken_s = event.data["taken_monotonic_s"] - begin_s
        span_s = 3 * 1.6
        lanes["meter reading"].append((max(0.0, taken_s - span_s), min(span_s, taken_s)))


def draw(path: Path) -> None:
    """Draw the timeline as SVG or PNG, by the file's ending."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    lanes, end_s = record()
    order = ["meter reading", "indoor exposure", "indoor transfer", "outdoor exposure", "outdoor transfer"]
    figure, axes = plt.subplots(figsize=(10, 2.8), layout="constrained")
    for row, name in enumerate(reversed(order)):
        axes.broken_barh(lanes[name], (row - 0.36, 0.72), color=COLOURS[name.split()[1]], linewidth=0)
    axes.set_yticks(range(len(order)), list(reversed(order)))
    axes.set_xlim(0, end_s)
    axes.set_xlabel("seconds")
    axes.set_title(f"One full capture, 9 + 9 frames at full size on simulated instruments: {end_s:.1f} s", fontsize=10)
    axes.grid(axis="x", alpha=0.3)
    figure.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else None)


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
