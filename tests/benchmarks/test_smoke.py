"""Every benchmark runs on the smallest input, in the form that is asked for, with the keys that must be there.

The figures of such runs mean nothing; that they are there, finite and reached by the code of today is what is checked.
"""

from __future__ import annotations

import importlib
import math
import os
import sys
from typing import Any

import pytest

from benchmarks import form, truth_rooms
from benchmarks.shared_data import DATA
from benchmarks.whole.studio import CHROMIUM
from mocks.rooms.light.light import QUALITIES, Quality
from mocks.rooms.model import Use
from processing.light.solver.irradiance import Effort

KEYS = {
    "capture": "limit_ratio skew_p99_ms peak_mb help_s",
    "truth": "furnace_err_pct sphere_err_pct form_factor_err_pct daylight_err_pct outdoor_lux_err_pct rooms_ok",
    "response": "rms_stops jpeg_rms_stops cpu_s rival_best_rms_stops dorf_median_stops dorf_p90_stops dorf_cover2_pct "
    "dorf_jpeg_median_stops dorf_jpeg_p90_stops",
    "hostile": "worlds scenes worst_cover95_pct median_cover95_pct smooth_cover95_pct textured_cover95_pct "
    "lux_cover95_pct worlds_better_than_opencv median_gain_over_opencv false_ghost_pct "
    "lens_known_median_cover95_pct lens_known_mean_cover95_pct drawn_worlds_better_than_opencv "
    "glare_in_family_near_pct glare_in_family_dark_kept_pct glare_hostile_near_pct glare_hostile_dark_kept_pct "
    "glare_lamps_near_pct theta_raw_gain theta_raw_cover95_pct spectral_lux_err_pct spectral_lux_cover95_pct "
    "spectral_indoor_lux_err_pct spectral_indoor_lux_cover95_pct "
    "odd_even_canon_cover95_pct odd_even_room_cover95_pct smooth_worst_cover95_pct smooth_median_cover95_pct "
    "textured_worst_cover95_pct textured_median_cover95_pct p95_err_stops cover68_pct decade_bias_stops "
    "film_cover95_pct film_err_stops hostile_rigs hostile_rigs_refused",
    "merge": "cpu_ratio_robertson cpu_ratio_debevec median_err_stops p95_err_stops decade_bias_stops "
    "jpeg_median_err_stops jpeg_p95_err_stops decode_ratio peak_mb coverage68_pct coverage95_pct",
    "photometry": "k1_err_pct k2_err_pct indoor_median_err_pct indoor_p95_err_pct outdoor_lux_err_pct "
    "zenith_colour_err_pct staged_cover95_pct canon_lux_err_pct canon_unscaled_lux_err_pct",
    "sphere": "speedup_py360convert remap_ratio uniform_err hemisphere_err sun_energy_err_pct",
    "room": "iou3d_empty_median iou3d_furnished_median corner_err_pct window_iou iou3d_zind_median seconds "
    "iou3d_zind_inside_mean confidence_brier_zind_inside constant_brier_zind_inside windows_precision_zind_own_room "
    "doors_recall_zind_own_room",
    "detect": "furniture_iou_sim sunny_rooms furniture_iou_real furniture_recall_real furniture_iou_real_fused "
    "furniture_recall_real_fused equipment_left_sim target_share_ratio false_sun_pictures seconds",
    "real": "pictures mean_grade share_at_4 rests_px_share two_tone_planes seam_planes halved_doors skirting_lost "
    "skirting_walls floor_turned_deg own_mean_grade own_rests_px_share own_seam_planes",
    "remove": "npp_psnr_db npp_gain_db room_median_err_pct room_gain_db seconds_full",
    "arrange": "hard_violations layouts rooms placed_all_pct p95_ms seven_p95_ms paper_faulty_pct",
    "steady": "steady_pct steady_first_pct moved_p50_m moved_p90_m placed_all_pct score_mean found_mean median_ms",
    "albedo": "median_err p95_err relight_median_err_pct",
    "render": "analytic_err_pct radiance_diff_pct equal_error_speedup changed_median_err_pct",
    "relight": "speedup median_err_pct",
    "end_to_end": "luminance_median_err_pct iou3d_median empty_median_err_pct staged_median_err_pct seconds peak_mb",
    "emptying": "filled_median_err_pct filled_bias_pct all_median_err_pct near_holes_p95_err_pct staged_median_err_pct "
    "staged_bias_pct staged_above_15 pane_worst_pct pane_median_pct depth_err_pct cpu_s clipped_windows "
    "clipped_windows_err_stops clipped_windows_cover90_pct",
    "stills": "ceiling_ab_err clipped_window_share wall_ab_err before_after_moved_pct cpu_ms_mpx "
    "stills_rooms niqe_captured niqe_staged realism_mean realism_share_at_4",
    "batch": "done wrong",
    "files": "",
    "studio": "corner_iou_gain drag_ms relit_ms relit_worst_ms preview_s first_page_s full_size_s server_peak_mb "
    "tab_mb",
    "pages": "index_mb index_first_paint_s index_axe index_asked index_too_wide_px lab_mb lab_first_paint_s lab_axe",
    "instruments": "recorded_bodies constants_checked soak_captures soak_lost soak_growth_pct late_partner_cases "
    "late_partner_lost clock_cases clock_lost",
    "qualities": "runs refused draft_cpu_s standard_cpu_s reference_cpu_s draft_luminance_median_err_pct "
    "standard_room_err_pct standard_empty_median_err_pct standard_staged_median_err_pct",
    "pipeline": "quarter_cpu_s quarter_peak_mb quarter_disk_mb rerun_s rerun_unneeded_cpu_s draft_cpu_s draft_moved_m "
    "one_more_cpu_s first_use_extra_cpu_s first_use_wheel_extra_cpu_s growth_exponent zenith_colour_err_pct",
}
NEEDS = {
    "photometry": "brackets/canon5d2_8mm_bracket",
    "response": "curves",
    "room": "panoramas/zind",
    "detect": "panoramas",
    "real": "panoramas/furnished",
    "remove": "textures",
    "batch": "paper",
    "arrange": "floorplans",
    "hostile": "curves",
}
"""What of the shared data a benchmark reads; it is beside the checkout or the test is skipped."""
LONG = {
    *("albedo", "arrange", "batch", "capture", "detect", "emptying", "end_to_end", "files", "hostile", "instruments"),
    *("merge", "pages", "photometry", "pipeline", "qualities", "real", "relight", "remove", "render", "response"),
    *("room", "sphere", "steady", "stills", "studio", "truth"),
}
"""Two seconds of CPU time or more even so, kernels compiled: they run with `make torture` (DAYLIT_TORTURE=1)."""
ROOM_ROWS = 128
"""Of the truth panoramas in the place of 512."""
SMALLER: dict[str, Any] = {
    "QUICK_ROOMS": 1,
    "QUICK_HOUSES": 1,
    "QUICK_GENERATED": 0,
    "QUICK_SIZE": (336, 168),
    "SMALL_SIZE": (336, 168),
    "FULL_SIZE": (672, 336),
    "QUICK_DIVISOR": 16,
    "RIG_DIVISOR": 16,
    "RUNS": 1,
    "HELP_RUNS": 1,
    "QUICK_SUN_SIZES": (100,),
    "QUICK_VIEW_REPEATS": 1,
}
"""Constants of any benchmark that make its quick run smaller still."""
SMALL: dict[str, dict[str, Any]] = {
    "albedo": {"light.albedo.ROWS": 64, "light.albedo.OUTDOOR_ROWS": 64, "light.albedo.RELIGHT_ROWS": 16},
    "arrange": {"layout.arrange.QUICK_ROOMS": 2},  # one of them of those that were not tuned on
    "files": {"whole.files.QUICK": (420, 210)},
    "response": {
        "photometry.response.QUICK_SIZE": (420, 210),
        "hostile.dorf.MOST": 4,
        "hostile.dorf.SIZE": (420, 210),
        "photometry.response.QUICK_COLOUR_HDRI_SAMPLES": 20,
    },
    "hostile": {
        "hostile.hostile.QUICK_WORLDS": (1,),
        "hostile.hostile.QUICK_RIGS": 2,
        "hostile.glare.FRAME": (360, 240),
    },
    "merge": {"photometry.merge_rivals.COLOUR_HDRI_SAMPLES": 20, "photometry.merge.QUICK_SIZE": (210, 105)},
    "relight": {
        "light.relight.HEIGHT": 32,
        "light.relight.VIEW_ROWS": 32,
        "light.relight.LONG": Effort(pixel_samples=4, patch_samples=16, sun_samples=16, clean=False),
        "light.relight_photo.QUICK_ROWS": 64,
        "light.albedo.OUTDOOR_ROWS": 64,
    },
    "render": {
        "light.render.QUICK_TRUTH": {"pixels": 50, "rays": 32, "patch_rays": 16},
        "light.render.QUICK_SAMPLES": 16,
        "light.render.QUICK_STAGED_ROWS": 24,
        "light.render.QUICK_RADIANCE_SAMPLES": 32,
        "light.render.REFERENCE": Effort(texel_m=0.2, patch_samples=16, rows=64, pixel_samples=16, sun_samples=16),
        "light.render_growth.SMALL_ROWS": 64,
        "light.render_growth.QUICK_WIDTHS": (64, 128),
        "light.render_time.ROWS": 64,
        "light.render_time.REFERENCE_TEXEL_M": 0.2,
    },
    "remove": {"removal.rooms.FULL": (672, 336)},
    "truth": {
        "light.truth.QUICK_SPP": {"furnace": 256, "sphere": 256, "form_factor": 1024, "daylight": 256},
        "light.room_light.POINTS": 4,
        "light.room_light.RAYS": 64,
        "light.room_light.SAMPLES": 2**8,
        "photometry.sky_anchor.SPP": 2**6,
    },
}
"""Constants of one benchmark, below the package `benchmarks`."""


SMALL_WORLDS: dict[str, Any] = {
    "mocks.rooms.light.light.ENVIRONMENT_ROWS": 32,
    "mocks.rooms.sky.backdrop.COLUMNS": 512,
    "mocks.rooms.sky.backdrop.PIXEL_RAD": 2 * math.pi / 512,
    "mocks.rooms.sky.backdrop.ROWS": round(math.radians(56) / (2 * math.pi / 512)),
}
"""A coarse sky and skyline for simulated rooms, and few rays (`TRUTH_QUALITY`)."""
TRUTH_QUALITY = Quality(24, 4)


def small_truth(seed: int, use: Use | str | None = None, rows: int = ROOM_ROWS, **_kept: Any) -> Any:
    """Return a room with small panoramas; where rows must be a picture's, they are few already."""
    return truth_rooms.truth_of(seed, use, rows=rows if rows < 2 * ROOM_ROWS else ROOM_ROWS)


def shrink(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a benchmark and all that it has imported as small as they can be."""
    importlib.import_module(form.modules()[name])
    for module in [m for key, m in sys.modules.items() if key.startswith("benchmarks.") and m is not truth_rooms]:
        for constant, value in SMALLER.items():
            if hasattr(module, constant):
                monkeypatch.setattr(module, constant, value)
        if hasattr(module, "truth_of"):
            monkeypatch.setattr(module, "truth_of", small_truth)
        for listing in ("kept_list", "truth_list"):
            if hasattr(module, listing):
                monkeypatch.setattr(
                    module, listing, lambda split, _count, seed=0, **_: truth_rooms.truth_list(split, 1, seed)
                )
    small = {f"benchmarks.{place}": value for place, value in SMALL.get(name, {}).items()}
    for place, value in (SMALL_WORLDS | small).items():
        module_name, _, constant = place.rpartition(".")
        monkeypatch.setattr(importlib.import_module(module_name), constant, value)
    for light in (truth_rooms.QUALITY, truth_rooms.LIGHT_QUALITY):
        monkeypatch.setitem(QUALITIES, light, TRUTH_QUALITY)


def test_the_list_is_whole() -> None:
    assert sorted(KEYS) == form.names()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", sorted(KEYS))
def test_benchmark_runs_and_has_its_keys(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in LONG and os.environ.get("DAYLIT_TORTURE") != "1":
        pytest.skip("seconds to minutes of CPU time: set DAYLIT_TORTURE=1, or run make torture")
    needed = DATA / NEEDS.get(name, "")
    if name in NEEDS and not needed.is_dir():
        pytest.skip(f"shared data {NEEDS[name]} are not beside the checkout")
    if name in ("studio", "pages") and CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    shrink(name, monkeypatch)
    result = form.run_one(name, quick=True, seed=0)
    assert set(KEYS[name].split()) <= set(result["metrics"]), sorted(result["metrics"])
