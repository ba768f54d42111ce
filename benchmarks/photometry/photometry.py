"""End to end: a simulated rig is calibrated from its sessions, then rooms and skies are scaled and compared with truth.

Response curves, k2, fall-off and filter come from rig sessions; k1 from the meter's readings in each session. Truth is
the radiance that each pixel averages. ``indoor_*`` are by solid angle over all valid pixels, edges included; those with
``smooth`` leave out pixels within two of a step of 10 %, where JPEG and mixed pixels, not photometry, decide.
``k1_err_pct`` is against the camera's own gain, the veiling glare at the board counted in (0.5 % of the mean light
scatters in the simulated lens and none in the meter); ``k1_raw_err_pct`` is without. The sky leaves out 3 degrees
around the sun, whose light is in the illuminance; the veil seen around the image circle is treated as in
`daylit process`. ``sky_floor_*`` is what the same frames give with everything known (true curve, noise, veil, fall-off,
tint, scale): photon noise and JPEG; ``*_spot_*`` are of means over the meter's spot of 1/3 degree. ``further``: the
first room with the exposures that `daylit capture --noise 3` adds; ``noise_stated_*``: what it states of its frames.
``own_lens_*``: the first room with the panorama camera's stray light and fall-off measured (`--lamp`, `--turned`).
``zenith_*``: the demo's blue sky, calibrated by the command (`zenith`). ``staged_cover95_pct``: of staged pixels within
their 95 % interval, median of the rooms that `end_to_end` has kept; without any, of one room of its quick run.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.photometry.rig import Calibrated, Outdoor, calibrated_rig, measured, measured_again, with_own_lens
from benchmarks.photometry.zenith import zenith_errors
from benchmarks.seeds import seeds
from benchmarks.sessions import STOPS_S
from benchmarks.whole import end_to_end, pipeline
from mocks.optics.picture_cache import default_folder
from mocks.worlds.light import World
from mocks.worlds.simple_room import SimpleRoom
from station.capture.reference import LONGEST_FURTHER_S, error_by_noise, further_time_s
from station.capture.rig import known_times_s
from station.capture.rig_file import PAPER_OUTDOOR
from station.frames.check import FrameChecker
from station.session.manifest import load_manifest
from station.session.session import Side

QUICK_DIVISOR, FULL_DIVISOR = 4, 1
QUICK_ROOMS, FULL_ROOMS = 1, 3
ASKED_FRAC, MOST_FURTHER = 0.03, 3
GAIN = 0.6
"""Of the rooms' light: the sun then has 6e8 cd/m2, which the shortest frame just holds in all channels."""


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    """Return metrics; see the module's docstring."""
    divisor = QUICK_DIVISOR if quick else FULL_DIVISOR
    rig_seed, *rooms = seeds("test", 1 + (QUICK_ROOMS if quick else FULL_ROOMS), seed)
    with tempfile.TemporaryDirectory() as folder:
        rig = calibrated_rig(Path(folder), divisor, rig_seed)
        found = [measured(Path(folder) / f"room-{n}", rig, SimpleRoom(n, gain=GAIN), divisor, n) for n in rooms]
        first, room = SimpleRoom(rooms[0], gain=GAIN), Path(folder) / f"room-{rooms[0]}"
        own_lens = measured_again(room, with_own_lens(Path(folder), rig, divisor, rig_seed), first, divisor, rooms[0])
        further = _further(room, rig, first, divisor, rooms[0], found[0][1])
    k2 = rig.result.profile.k2
    assert k2 is not None
    inside, outside = [one for one, _ in found], [one for _, one in found]
    floors = [one.sky_floor for one in outside if one.sky_floor is not None]
    metrics: dict[str, float] = {
        "k1_err_pct": _worst(one.k1 for one in inside),
        "k1_raw_err_pct": _worst(one.k1_without_glare for one in inside),
        "k2_err_pct": _worst([k2.value / rig.k2_truth - 1]),
        "k2_white_err_pct": _worst([k2.white_ratio / rig.k2_truth - 1]),
        "k2_uncertainty_pct": round(100 * k2.relative_uncertainty, 3),
        "indoor_median_err_pct": _middle(one.median for one in inside),
        "indoor_p95_err_pct": _middle(one.p95 for one in inside),
        "indoor_smooth_median_err_pct": _middle(one.smooth_median for one in inside),
        "indoor_smooth_p95_err_pct": _middle(one.smooth_p95 for one in inside),
        "own_lens_k1_err_pct": _worst([own_lens.k1]),
        "own_lens_indoor_median_err_pct": round(100 * own_lens.median, 3),
        "own_lens_indoor_p95_err_pct": round(100 * own_lens.p95, 3),
        "outdoor_lux_err_pct": _worst(one.lux for one in outside),
        "sky_median_err_pct": _middle(one.sky.median for one in outside),
        "sky_p95_err_pct": _middle(one.sky.p95 for one in outside),
        "sky_spot_p95_err_pct": _middle(one.sky.spot_p95 for one in outside),
        "sky_floor_p95_err_pct": _middle(one.p95 for one in floors),
        "sky_floor_spot_p95_err_pct": _middle(one.spot_p95 for one in floors),
    }
    notes = [f"pictures at 1/{divisor} of full size, {len(rooms)} rooms; worst room for k1 and lux, else the median"]
    notes += [f"valid share of the panorama: {min(one.covered for one in inside):.1%} or more"]
    notes += [f"clipped share of the sky: {max(one.clipped_share for one in outside):.4%} or less"]
    notes += list(rig.result.profile.warnings)
    metrics |= (
        further | _canon(quick=quick, notes=notes) | _zenith(quick=quick) | _staged(seed, quick=quick, notes=notes)
    )
    return {"metrics": metrics, "notes": notes}


def _further(folder: Path, rig: Calibrated, world: World, divisor: int, seed: int, before: Outdoor) -> dict[str, float]:
    """Return figures of the session in ``folder`` (measured as ``before``) and of one with further exposures."""
    stops_s, found, stated = STOPS_S, before, _stated(folder)
    figures = {"noise_stated_p95_pct": round(100 * stated, 2)}
    for number in range(MOST_FURTHER):
        if stated <= ASKED_FRAC:
            break
        longest_s = max(stops_s)
        times_s = [t for t in {longest_s, *known_times_s(PAPER_OUTDOOR.kind)} if longest_s <= t <= LONGEST_FURTHER_S]
        stops_s = (*stops_s, further_time_s(stated, ASKED_FRAC, times_s))
        path = folder.with_name(f"{folder.name}-further-{number}")
        _, found = measured(path, rig, world, divisor, seed, stops_s)
        stated = _stated(path)
    return figures | {
        "further_exposures_s": sum(stops_s[len(STOPS_S) :]),
        "noise_stated_further_p95_pct": round(100 * stated, 2),
        "sky_further_median_err_pct": round(100 * found.sky.median, 3),
        "sky_further_p95_err_pct": round(100 * found.sky.p95, 3),
        "sky_further_spot_p95_err_pct": round(100 * found.sky.spot_p95, 3),
    }


def _stated(path: Path) -> float:
    manifest, circle = load_manifest(path), PAPER_OUTDOOR.image_circle
    frames = manifest.pictures(Side.OUTDOOR)
    with FrameChecker() as checker:
        facts = {f.stop: checker.inspect(path / f.file, exact=True, circle=circle) for f in frames}
    return error_by_noise(Side.OUTDOOR, facts, manifest.bracket.stops_s)


def _zenith(*, quick: bool) -> dict[str, float]:
    """Return the errors of the demo's zenith in a session of its own, processed until it is calibrated."""
    kept = default_folder().parent / "pipeline"
    profile = pipeline.rig_profile(kept)
    with tempfile.TemporaryDirectory() as folder:
        session = pipeline.fresh(pipeline.captured(kept, "small" if quick else "quarter"), Path(folder))
        pipeline.daylit(["process", str(session), "--calibration", str(profile), "--until", "calibrate"])
        return {key: round(value, 2) for key, value in zenith_errors(session, pipeline.WORLD).items()}


def _staged(seed: int, *, quick: bool, notes: list[str]) -> dict[str, float]:
    """Return how many pixels of staged pictures lie within their interval, per cent."""
    rows = [] if quick else [row for row in end_to_end.kept_rows(seed) if "staged_cover95_pct" in row]
    notes.append(
        f"staged_cover95_pct: {len(rows)} rooms of end_to_end" if rows else "staged_cover95_pct: one quick room"
    )
    rows = rows or end_to_end.rows_of(end_to_end.rig_profile(seed), seed, quick=True, rooms=1)
    found = [row["staged_cover95_pct"] for row in rows if "staged_cover95_pct" in row]
    return {"staged_cover95_pct": round(statistics.median(found), 2)} if found else {}


def _canon(*, quick: bool, notes: list[str]) -> dict[str, float]:
    """Return the real bracket's illuminance, where the shared bracket is."""
    from benchmarks.photometry import canon_real as _canon_real

    try:
        found = _canon_real.canon_real(quick=quick)
    except FileNotFoundError as error:
        notes.append(f"the real bracket was not measured: {error}")
        return {}
    return _numbers(found) | _canon_by_command(_canon_real.FOLDER, _canon_real.PUBLISHED_LUX)


def _canon_by_command(folder: Path, published_lux: float) -> dict[str, float]:
    """Return the real bracket's errors by the documented commands: by its owners' factor file, and without a scale."""
    found = {}
    cal, curve = folder / "calibration_files", folder / "response_function_files" / "Response_function.rsp"
    scaled = ("--response", curve, "--cal", cal / "CF_f5d6.cal")
    for key, more in (("canon_lux", scaled), ("canon_unscaled_lux", ())):
        asked = (
            "figures",
            folder,
            "--view",
            "fisheye,equisolid,180",
            "--cal",
            cal / "vignetting_f5d6.cal",
            *more,
            "--json",
        )
        said = subprocess.run(
            (sys.executable, "-m", "daylit", *map(str, asked)), capture_output=True, check=True, text=True
        )
        found_lx = json.loads(said.stdout)["figures"]["illuminance_lx"]
        value, doubt = found_lx["value"], found_lx["uncertainty"]
        found[key] = value
        found[f"{key}_err_pct"] = 100 * (value / published_lux - 1)
        found[f"{key}_sigmas"] = (value - published_lux) / doubt
    return found


def _numbers(found: Any) -> dict[str, float]:
    """Return the figures of the real bracket under their keys."""
    return {key: value for key, value in found.items() if isinstance(value, int | float)}


def _worst(values: Any) -> float:
    return round(100 * max(abs(value) for value in values), 3)


def _middle(values: Any) -> float:
    return round(100 * statistics.median(values), 3)
