"""Results of a session that nobody took: small pictures, known numbers, everything that the report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from processing.exchange.gltf import scene_glb
from processing.figures.figures import camera_figures, outdoor_figures, surface_figures
from processing.layout.arrangement import Arrangement, Arrangements, PlacedItem
from processing.layout.plan import from_room_model
from processing.layout.plan_files import plan_to_mapping
from processing.pictures.exr import write_exr
from processing.pictures.images import LuminanceImage, Validity
from processing.running.reads import SUMMARY, Noted
from processing.sphere import Equirectangular
from processing.stages.contract import StageContext
from processing.stages.parameters import MOST_STAGED, NO_SUCH, ReportParameters
from station.session.session import SessionManifest
from tests.processing.light.rooms import box, box_room, scene_of, uniform_sky
from tests.station.session.sessions import manifest

SIZE_PX = (240, 120)
PLAN = b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 3"><rect width="4" height="3" fill="#ccc"/></svg>'
Results = dict[str, dict[str, Any]]
"""Artifacts by stage and name; a stage that was skipped has none."""


def picture(tint: tuple[float, float, float], seed: int, *, absolute: bool = True) -> LuminanceImage:
    """A panorama of 1 to 1000 cd/m2, brighter to the right, with some grain; a sun, a black and a clipped pixel."""
    width, height = SIZE_PX
    rng = np.random.default_rng(seed)
    slope = np.geomspace(1.0, 1000.0, width, dtype=np.float64)[None] * np.linspace(1.3, 0.7, height)[:, None]
    rgb = (slope * rng.uniform(0.97, 1.03, (height, width)))[..., None] * np.array(tint)
    rgb[10, 20], rgb[11, 21] = 1.6e9, 0.0
    validity = np.zeros((height, width), np.uint8)
    validity[10, 20], validity[11, 21] = Validity.CLIPPED, Validity.DARK
    uncertainty = rng.uniform(0.01, 0.05, (height, width)).astype(np.float32)
    uncertainty[11, 21] = np.inf
    geometry = Equirectangular(width, height)
    return LuminanceImage(rgb.astype(np.float32), uncertainty, validity, geometry, 0.02, absolute=absolute)


def results(*, alternatives: int = 2, absolute: bool = True) -> Results:
    """Artifacts of every stage, in dictionaries of one's own; the pictures are everybody's."""
    return {stage: dict(part) for stage, part in _made(alternatives, absolute).items()}


@cache
def _made(alternatives: int, absolute: bool) -> Results:
    photograph = picture((1.0, 1.0, 1.0), 1, absolute=absolute)
    room = box_room()
    staged = {f"staged-{k}": picture((1.5, 0.6 + 0.2 * k, 0.2), 2 + k, absolute=absolute) for k in _up_to(alternatives)}
    scene = scene_of(room, uniform_sky()).furnished((box((1.0, 0.5, 0.4), (1.2, 0.6, 0.8), name="table"),))
    bed = PlacedItem(id="bed", category="bed", size_m=(1.4, 2.0, 0.85), t_m=(1.5, 0.4, 0.0), theta_rad=0.0)
    layouts = tuple(
        Arrangement(rank=k, items=(bed,), score=0.91, scores={}, rule_set="standard", differs_by="the bed turned")
        for k in _up_to(alternatives)
    )
    rug = {"id": "rug-s1", "category": "rug", "size_m": [2, 1.4, 0.01], "theta_rad": 0.0, "t_m": [1.5, 0.4, 0.0]}
    lamp = {"id": "lamp-s1", "category": "table lamp", "size_m": [0.3, 0.3, 0.4], "theta_rad": 0.0, "t_m": [1, 0, 0.5]}
    result = {
        "items": ["bed"],
        "style": "scandinavian",
        "changed_share": 0.2,
        "error": 0.02,
        "furniture_share": 0.1,
        "added": [rug, lamp],
    }
    return {
        "merge": {"response": {}},
        "calibrate": {"indoor": photograph, "calibration": {"indoor": _scale(absolute=absolute)}},
        "room": {"room": room},
        "figures": {"light_figures": _light(photograph)},
        "detect": {"target": np.zeros((SIZE_PX[1], SIZE_PX[0]), bool)},
        "remove": {"empty": picture((0.5, 0.7, 1.4), 2, absolute=absolute), "filled": _middle()},
        "materials": {
            "materials": {
                "outdoors": "outdoor picture",
                "surfaces": [{"name": "floor", "albedo": 0.2, "albedo_rgb": [0.3, 0.2, 0.1]}],
                "windows": [{"opening": 0, "transmittance": [0.8, 0.8, 0.8], "covered_share": 0.1}],
                "notes": [],
            }
        },
        "arrange": {
            "arrangement": Arrangements(
                plan=plan_to_mapping(from_room_model(room)),
                rule_set="standard",
                asked=("bed",),
                seed=0,
                arrangements=layouts,
            ),
            **{f"plan-{k}": PLAN for k in _up_to(alternatives)},
        },
        "render": {
            **staged,
            "staged": {"method": "differential", "alternatives": [{"rank": k, **result} for k in _up_to(alternatives)]},
            "staged-1-model": scene_glb(scene),
        },
    }


def context(folder: Path, found: Mapping[str, Mapping[str, Any]], *, no_staged_label: bool = False) -> StageContext:
    """What the report is given of such results; files and pictures of them are in ``folder``, as a session's."""
    session: SessionManifest = manifest(name="made up")
    files = {name: data for part in found.values() for name, data in part.items() if isinstance(data, bytes)}
    for stage, part in found.items():
        where = folder / "stages" / stage
        where.mkdir(parents=True, exist_ok=True)
        for name, value in part.items():
            if isinstance(value, LuminanceImage):
                write_exr(where / f"{name}.exr", value)
            elif isinstance(value, bytes):
                (where / _file(name)).write_bytes(value)

    def fetch(stage: str, name: str) -> Any:
        value = found.get(stage, {}).get(name)
        if isinstance(value, dict):  # as a run hands it on: a mapping that is no dict
            return Noted(value, f"{stage}/{name}", lambda _read: None)
        return folder / "stages" / stage / _file(name) if name in files and value is not None else value

    def summary(stage: str) -> Noted:
        optional = ("panorama", "outdoor", "empty", *(f"staged-{k}" for k in range(1, MOST_STAGED + 1)))
        left_out = {name: NO_SUCH for name in optional if name not in found.get(stage, {})}
        blank = {"metrics": {}, "warnings": [], "left_out": left_out, "honoured": {}}
        done = stage in found or stage == "verify"
        return Noted(blank if done else {**blank, "skipped": "not asked"}, f"{stage}/{SUMMARY}", lambda _read: None)

    out = folder / "page"
    out.mkdir(exist_ok=True)
    parameters = ReportParameters(no_staged_label=no_staged_label)
    return StageContext(session, folder, out, parameters, fetch, summary)


def without(found: Results, *stages: str) -> Results:
    """The same where some stages were skipped."""
    return {stage: part for stage, part in found.items() if stage not in stages}


def darker(image: LuminanceImage, factor: float) -> LuminanceImage:
    return replace(image, rgb=image.rgb * np.float32(factor))


def _file(name: str) -> str:
    """What a file's artifact is called on disk."""
    return f"{name.removesuffix('-model')}.glb" if name.endswith("-model") else f"{name}.svg"


def _up_to(count: int) -> range:
    return range(1, count + 1)


def _middle() -> np.ndarray:
    mask = np.zeros((SIZE_PX[1], SIZE_PX[0]), bool)
    mask[60:80, 100:140] = True
    return mask


def _light(photograph: LuminanceImage) -> dict[str, Any]:
    units = {"luminance": photograph.unit, "illuminance": "lx" if photograph.absolute else photograph.unit}
    return {
        "absolute": photograph.absolute,
        "units": units,
        "camera": camera_figures(photograph, height_m=1.6, heading_rad=0.5),
        "outdoor": outdoor_figures(None, {}),
        "level_ratio": None,
        "meter": None,
        "surfaces": surface_figures(photograph, None),
    }


def _scale(*, absolute: bool) -> dict[str, Any]:
    light = {"value": 178.6, "uncertainty": 3.3}
    known = {
        "k1": 37.65,
        "k1_relative_uncertainty": 0.018,
        "k1_parts": {"meter": 0.012, "spot": 0.004},
        "falloff": "off",
        "target": {"source": "recorded"},
        "meter_cd_m2": 46.3,
        "meter_drift_frac": None,
        "illuminance_lx": {"up": light},
    }
    unknown = {
        "absolute": False,
        "source": "one photograph",
        "clipped_share": 0.01,
        "k1": None,
        "k1_parts": {},
        "meter_cd_m2": None,
        "illuminance_lx": {},
    }
    return known if absolute else {**known, **unknown}
