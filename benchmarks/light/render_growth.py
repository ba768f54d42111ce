"""What a staged picture costs as it grows: in pixels, in triangles of furniture, and as its error falls; with plots.

One room (5 x 4 m, sun through a window) with the built-in living room's furniture, staged by `differential` with one
light for all sizes (256 rows, 16 rays): what grows with pixels are sight, sun, edges and texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.kept_rows import Rows
from benchmarks.light.render_scenes import EYE, boxes, clear_sky, plain_room, room_model
from benchmarks.memory import MemoryWatch
from benchmarks.paired import cost_of
from benchmarks.plots import save_figure
from processing.ground.arrays import Floats
from processing.layout.arrange import arrange
from processing.layout.assumed import with_door
from processing.layout.items import set_items
from processing.layout.models.catalogue import Catalogue
from processing.layout.plan import from_room_model
from processing.light.picture.composite import Bare, differential
from processing.light.picture.render import render
from processing.light.scene.scene import Part
from processing.light.solver.irradiance import Effort
from processing.sphere import Equirectangular
from processing.stages.furnishing import furniture_parts

WIDTHS, QUICK_WIDTHS = (512, 1024, 2048, 6720), (128, 256)
SMALL_ROWS = 256
"""Of the photograph that is made larger."""
TRIANGLES_WIDTH = 1024
EFFORT = Effort(cleaning="fast")
QUICK_EFFORT = Effort(texel_m=0.2, patch_samples=16, rows=128, pixel_samples=4, cleaning="fast")


def growth(rows: Rows, *, quick: bool, seed: int) -> dict[str, Any]:
    """Return CPU seconds and peak memory by width, and CPU seconds by triangles."""
    effort = QUICK_EFFORT if quick else EFFORT
    parts = boxes() if quick else _living()
    by_width = {
        str(w): rows.row(f"growth {w}", lambda w=w: _staged(w, parts, effort, seed))  # type: ignore[misc]
        for w in (QUICK_WIDTHS if quick else WIDTHS)
    }
    if quick:
        return {"width": by_width, "triangles": {}}
    sets = {"boxes": boxes(), "few": parts[:6]}
    by_triangles = {
        name: rows.row(f"growth {name}", lambda some=some: _staged(TRIANGLES_WIDTH, some, effort, seed))  # type: ignore[misc]
        for name, some in sets.items()
    } | {"all": by_width[str(TRIANGLES_WIDTH)]}
    return {"width": by_width, "triangles": by_triangles}


def _living() -> tuple[Part, ...]:
    room, _ = with_door(room_model(5, 4, 2.7, (1.5, 3.5, 0.8, 2.3)))
    found = arrange(from_room_model(room, keep_camera_free=True), set_items("living"), n=1, seed=0)
    return furniture_parts(found.arrangements[0].items, Catalogue.builtin("scandinavian"))


def _staged(width: int, parts: tuple[Part, ...], effort: Effort, seed: int) -> dict[str, float]:
    room = plain_room(clear_sky())
    small = render(room, Equirectangular(2 * SMALL_ROWS, SMALL_ROWS), EYE, effort=effort, seed=seed).rgb
    photograph: Floats = np.asarray(cv2.resize(small, (width, width // 2), interpolation=cv2.INTER_LINEAR), np.float32)
    differential(small[::4, ::4].copy(), room, parts[:1], EYE, effort=Effort(patch_samples=2, pixel_samples=2, rows=32))
    with MemoryWatch() as memory:
        cost = cost_of(lambda: differential(photograph, Bare.of(room, effort), parts, EYE, effort=effort, seed=seed))
    return {
        "cpu_s": cost.cpu_s - memory.cpu_s,
        "peak_mb": memory.peak_mb,
        "triangles": sum(len(p.faces) for p in parts),
    }


def draw(found: dict[str, Any], race: Sequence[dict[str, Any]], name: str = "render-growth.png") -> None:
    """Draw growth in pixels and triangles, and our error against time in all rooms of the race."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (pixels, triangles, error) = plt.subplots(1, 3, figsize=(10.5, 3.2), layout="constrained")
    sizes = [(int(w) ** 2 / 2e6, row["cpu_s"]) for w, row in found["width"].items()]
    pixels.loglog(*zip(*sizes, strict=True), "o-", color="black")
    pixels.set(xlabel="megapixels", ylabel="CPU seconds", title="pixels")
    counts = sorted((row["triangles"], row["cpu_s"]) for row in found["triangles"].values())
    triangles.semilogx(*zip(*counts, strict=True), "s-", color="black")
    triangles.set(xlabel="triangles of furniture", title="triangles", ylim=(0, None))
    for kind, style in (("sun", "o-"), ("overcast", "s--"), ("lamps", "D:")):
        for number, row in enumerate(r for r in race if r["kind"] == kind):
            mine = sorted((v["cpu_s"], 100 * v["rel"]) for k, v in row.items() if k.startswith("ours_"))
            error.loglog(
                *zip(*mine, strict=True), style, color="black", ms=3, lw=0.8, label=kind if number == 0 else None
            )
    error.set(xlabel="CPU seconds (512 x 256)", ylabel="relative rms error, %", title="error")
    error.legend(frameon=False)
    _ticks(pixels, (0.2, 0.5, 2, 5, 20), (5, 10, 20, 50, 100))
    _ticks(error, (1, 1.5, 2, 3, 5), (1, 2, 5, 10, 20))
    for axes in (pixels, triangles, error):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.25)
    save_figure(figure, Path(name))


def _ticks(axes: Any, across: Sequence[float], up: Sequence[float]) -> None:
    """Label two logarithmic axes with plain numbers."""
    from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

    for axis, places in ((axes.xaxis, across), (axes.yaxis, up)):
        axis.set_major_locator(FixedLocator(list(places)))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
