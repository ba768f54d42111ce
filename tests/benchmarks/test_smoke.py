"""Every benchmark runs on the smallest input, in the form that is asked for, with the keys that must be there.

The figures of such runs mean nothing; that they are there, finite and reached by the code of today is what is checked.
"""

from __future__ import annotations

import importlib
from typing import Any

import pytest

from benchmarks import form
from benchmarks.shared_data import DATA

KEYS = {
    "capture": "limit_ratio skew_p99_ms peak_mb help_s",
    "truth": "furnace_err_pct sphere_err_pct form_factor_err_pct daylight_err_pct outdoor_lux_err_pct rooms_ok",
    "response": "rms_stops cpu_s rival_best_rms_stops",
    "merge": "cpu_ratio_robertson cpu_ratio_debevec median_err_stops p95_err_stops decade_bias_stops "
    "jpeg_median_err_stops jpeg_p95_err_stops decode_ratio peak_mb coverage68_pct coverage95_pct",
    "photometry": "k1_err_pct k2_err_pct indoor_median_err_pct indoor_p95_err_pct outdoor_lux_err_pct",
    "sphere": "speedup_py360convert remap_ratio uniform_err hemisphere_err sun_energy_err_pct",
    "room": "iou3d_empty_median iou3d_furnished_median corner_err_pct window_iou iou3d_zind_median seconds",
    "detect": "furniture_iou_sim sunlight_iou_sim furniture_iou_real furniture_recall_real seconds",
    "remove": "npp_psnr_db npp_gain_db room_median_err_pct room_gain_db seconds_full",
    "arrange": "hard_violations layouts rooms placed_all_pct p95_ms seven_p95_ms paper_faulty_pct",
    "albedo": "median_err p95_err relight_median_err_pct",
    "render": "analytic_err_pct radiance_diff_pct equal_error_speedup changed_median_err_pct",
    "relight": "speedup median_err_pct",
    "end_to_end": "luminance_median_err_pct iou3d_median empty_median_err_pct staged_median_err_pct seconds peak_mb",
    "batch": "done wrong",
    "files": "",
}
NEEDS = {
    "room": "panoramas/zind",
    "detect": "panoramas",
    "remove": "textures",
    "batch": "paper",
    "arrange": "floorplans",
}
"""What of the shared data a benchmark reads; it is beside the checkout or the test is skipped."""
SMALL: dict[str, dict[str, Any]] = {
    "truth": {
        "benchmarks.light.truth.QUICK_SPP": {"furnace": 256, "sphere": 256, "form_factor": 1024, "daylight": 256},
        "benchmarks.light.truth.QUICK_ROOMS": 1,
    },
    "files": {"benchmarks.whole.files.QUICK": (168, 84)},
    "response": {"benchmarks.photometry.response.QUICK_SIZE": (336, 168), "benchmarks.photometry.response.RUNS": 1},
    "merge": {
        "benchmarks.photometry.merge.QUICK_SIZE": (336, 168),
        "benchmarks.photometry.merge.SMALL_SIZE": (336, 168),
    },
    "sphere": {"benchmarks.photometry.sphere.QUICK_SUN_SIZES": (100,), "benchmarks.photometry.sphere.WIDTH_PX": 336},
    "arrange": {"benchmarks.layout.arrange.QUICK_ROOMS": 2},
}
"""What is smaller still than in a quick run."""


def test_the_list_is_whole() -> None:
    assert sorted(KEYS) == form.names()


@pytest.mark.parametrize("name", sorted(KEYS))
def test_benchmark_runs_and_has_its_keys(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    needed = DATA / NEEDS.get(name, "")
    if name in NEEDS and not needed.is_dir():
        pytest.skip(f"shared data {NEEDS[name]} are not beside the checkout")
    for place, value in SMALL.get(name, {}).items():
        module, _, constant = place.rpartition(".")
        monkeypatch.setattr(importlib.import_module(module), constant, value)
    result = form.run_one(name, quick=True, seed=0)
    assert set(KEYS[name].split()) <= set(result["metrics"]), sorted(result["metrics"])
