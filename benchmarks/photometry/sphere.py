"""Geometry of the sphere: sums of light, a sun through each projection pair, views against py360convert and cv2.remap.

``speedup_py360convert`` compares CPU time on views that neither has seen before, ``_warm`` on views whose maps both
have (``_warm_wall``: wall time). ``remap_ratio`` is our CPU time over that of a bare `cv2.remap` with its float32 maps
made before, both on the same 8-bit panorama; ``remap_fixed_ratio`` with fixed-point maps, ``remap_float_ratio``
on a float32 panorama. ``chain_*`` and ``rivals.pcomb_pinterp``: the outdoor chain (fall-off, tint, geometry) of one
made sky by daylit and by Radiance. Round trips are rms errors over the rms of a band-limited truth, panorama to six
faces and back.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.photometry import sphere_chain as _sphere_chain
from benchmarks.photometry import sphere_light as _sphere_light
from benchmarks.photometry import sphere_views as _sphere_views
from benchmarks.plots import MARKERS, Point, save_figure

PLOT = Path("sphere-roundtrip.png")
WIDTH_PX, FACES = 1344, (168, 240, 336, 432, 672)
USUAL_FACE = 336
SUN_SIZES, QUICK_SUN_SIZES = (1000, 3600), (400,)
CHAIN_PX, QUICK_CHAIN_PX = 3000, 600
VIEW_REPEATS, QUICK_VIEW_REPEATS = 12, 4
ELEVATIONS_RAD = (0.9, 0.35)
FEW_PAIRS_ABOVE_PX = 2000
TRIPS = ("roundtrip_err", "roundtrip_overlapping_err")


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    sums = _sphere_light.sums(seed, quick=quick)
    suns: dict[str, float] = {}
    for size in QUICK_SUN_SIZES if quick else SUN_SIZES:
        for elevation in ELEVATIONS_RAD[: 1 if quick or size > FEW_PAIRS_ABOVE_PX else 2]:
            few = quick or size > FEW_PAIRS_ABOVE_PX
            found = _sphere_light.sun_errors(size, elevation, quick=few)
            suns |= {f"{name}, sun at {elevation:.2f} rad": error for name, error in found.items()}
    worst = max(suns, key=lambda name: abs(suns[name]))
    repeats = QUICK_VIEW_REPEATS if quick else VIEW_REPEATS
    speed = _sphere_views.speed(pairs=3 if quick else 7, repeats=repeats)
    trips = {face: _sphere_views.round_trips(WIDTH_PX, face, seed) for face in ((USUAL_FACE,) if quick else FACES)}
    if not quick:
        points = [Point(name, face, error) for face, errors in trips.items() for name, error in errors.items()]
        error_against_size(points, PLOT, panorama_px=WIDTH_PX)
    chain, notes = _chain(quick=quick)
    usual = trips[USUAL_FACE]
    py360 = speed.py360convert
    return {
        "metrics": {
            "speedup_py360convert": round(1 / speed.first_views.cpu_ratio, 2),
            "speedup_py360convert_warm": round(repeats / py360.cpu_ratio, 2),
            "speedup_py360convert_warm_wall": round(repeats / py360.wall_ratio, 2),
            "remap_ratio": round(speed.remap.cpu_ratio, 4),
            "remap_ratio_spread": round(speed.remap.cpu_ratio_spread, 4),
            "remap_wall_ratio": round(speed.remap.wall_ratio, 4),
            "remap_fixed_ratio": round(speed.remap_fixed.cpu_ratio, 4),
            "remap_float_ratio": round(speed.remap_float.cpu_ratio, 4),
            "view_ms": round(py360.ours.cpu_s / repeats / len(_sphere_views.LOOKS_DEG) * 1000, 3),
            "first_view_ms": round(speed.first_views.ours.cpu_s / len(_sphere_views.LOOKS_DEG) * 1000, 1),
            "uniform_err": sums.uniform,
            "hemisphere_err": sums.hemisphere,
            "tilted_fisheye_err": sums.tilted_fisheye,
            "sun_energy_err_pct": round(abs(suns[worst]), 5),
            "roundtrip_err": usual["ours, linear"],
            "roundtrip_overlapping_err": _sphere_views.overlapping_round_trip(WIDTH_PX, USUAL_FACE, seed),
            **{f"chain_{key}": value for key, value in chain.pop("ours", {}).items()},
        },
        "rivals": {
            "py360convert": {
                "first_view_ms": round(speed.first_views.rival.cpu_s / len(_sphere_views.LOOKS_DEG) * 1000, 1),
                "view_ms": round(py360.rival.cpu_s / len(_sphere_views.LOOKS_DEG) * 1000, 2),
                "roundtrip_err": usual["py360convert, bilinear"],
                "roundtrip_cubic_err": usual["py360convert, bicubic"],
            },
            "cv2_remap": {"roundtrip_err": usual["plain cv2.remap"]},
            **chain,
        },
        "units": dict.fromkeys(TRIPS, "of the truth's rms"),
        "notes": [f"the sun's worst of {len(suns)}: {worst} ({suns[worst]:+.4f} %)", *notes],
    }


def _chain(*, quick: bool) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return the outdoor chain of both tools, and why there is none."""
    try:
        return _sphere_chain.outdoor_chain(QUICK_CHAIN_PX if quick else CHAIN_PX, pairs=2 if quick else 5), []
    except RuntimeError as error:
        return {}, [f"the outdoor chain was not compared: {error}"]


def error_against_size(points: Sequence[Point], path: Path, *, panorama_px: int) -> Path:
    """Draw each method's round-trip error (``Point.error``) against face size (``Point.seconds`` holds pixels)."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.ticker import NullFormatter, StrMethodFormatter

    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for number, method in enumerate(dict.fromkeys(p.method for p in points)):
        mine = [p for p in points if p.method == method]
        axes.plot([p.seconds for p in mine], [p.error for p in mine], marker=MARKERS[number], lw=1, label=method)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="pixels across a cube face",
        ylabel="rms error / rms of the truth",
        title=f"Panorama of {panorama_px} px to six faces and back",
    )
    sizes = sorted({p.seconds for p in points})
    axes.set_xticks(sizes)
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, which="major", color="0.9")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    return save_figure(figure, path)
