"""The stage report: gathers what the stages before it made into one page."""

from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np

from processing.calibration.outdoor.sun_place import with_zone, zone_at
from processing.ground.room_model import RoomModel
from processing.ground.tables import table_of
from processing.pictures.display import Display
from processing.pictures.writing import write_bytes
from processing.report import calibration_sections
from processing.report.data import FileLine, Quantity, ReportData, Section, StageLine, WarningLine
from processing.report.page import build_client_page, build_page, client_data
from processing.report.room_states import display_in
from processing.report.sections import TINTS, detect_section, floor_area_m2, remove_section, room_section
from processing.report.staging import kept, staging_sections
from processing.sphere import Equirectangular
from processing.stages.contract import StageContext, StageOutput
from processing.stages.parameters import MOST_STAGED, NO_SUCH
from processing.stages.upright import upright_panorama
from station.session.session import SessionManifest, Side

BEFORE = (
    *("verify", "merge", "calibrate", "room", "figures"),
    *("detect", "light", "remove", "materials", "arrange", "render", "stills", "day"),
)
"""Stages that the report covers; each of them is also in its row's ``needs``."""
FILES = {
    **{(stage, name): what for stage, named in table_of(__package__, "files").items() for name, what in named.items()},
    **{("stills", f"still-{k}.jpg"): "still; beside it luminance (EXR), original" for k in range(1, 13)},
    **{("day", f"hour-{k}.jpg"): "the first still's frame at another hour of its day" for k in range(1, 25)},
    **{("render", f"staged-{k}.exr"): f"staged, alternative {k}, in cd/m2" for k in range(1, MOST_STAGED + 1)},
    **{("render", f"staged-{k}.glb"): f"model of alternative {k}" for k in range(1, MOST_STAGED + 1)},
}


def run(context: StageContext) -> StageOutput:
    """Write index.html for a client and lab.html for the laboratory."""
    data = report_data(context)
    write_bytes(context.folder / "lab.html", build_page(data).encode())
    client = client_data(context, data)
    write_bytes(context.folder / "index.html", build_client_page(client).encode())
    metrics = {"sections": len(data.sections), "stills": len(client.stills)}
    cuts = {f"cuts-{k}": (context.folder / f"cuts-{k}.json.gz").is_file() for k in range(1, MOST_STAGED + 3)}
    parts = cuts | {"plan": client.plan is not None}
    made = dict.fromkeys(("page", "lab", "details", *(name for name, there in parts.items() if there)), True)
    return StageOutput(
        artifacts=made, metrics=metrics, left_out=dict.fromkeys(sorted(parts.keys() - made.keys()), NO_SUCH)
    )


def report_data(context: StageContext) -> ReportData:
    """Return what the page shows, from the session, the stages' summaries and their artifacts."""
    facts = context.artifact("calibrate", "calibration")
    unit, whole = context.part("panorama", (), None, lambda: _panorama(context))
    # First what is of one picture each, then all states side by side: so each is read from the disk once at most.
    own = [context.session.name, [frame.sha256 for frame in context.session.frames]]
    details = kept(context, "details", own, Section, lambda: _sections(context, facts))
    lead, staging = staging_sections(context, whole=whole)
    return ReportData(
        title=context.session.name,
        facts=session_facts(context.session),
        summary=(*_summary(facts), *_shape(context)),
        stages=tuple(_stage_line(name, context.summary(name)) for name in BEFORE),
        warnings=tuple(
            WarningLine(w["message"], name, w["code"]) for name in BEFORE for w in context.summary(name)["warnings"]
        ),
        lead=lead,
        sections=(*staging, *details),
        files=_files(context, unit),
        made_with=f"daylit {version('daylit')}",
        unit=unit,
    )


def _panorama(context: StageContext) -> list[str | bool]:
    """Return the unit of luminance, and whether the room was seen all around."""
    image = upright_panorama(context)
    return [image.unit, isinstance(image.geometry, Equirectangular) and image.rgb.shape[1] == 2 * image.rgb.shape[0]]


def session_facts(session: SessionManifest) -> tuple[tuple[str, str], ...]:
    """Return what a reader wants to know of the session first: label and text."""
    site = session.site
    when = session.taken_utc
    local = with_zone(when or session.created_utc, zone_at(site.latitude_deg, site.longitude_deg))
    found = [("Session", session.session_id), ("Taken" if when else "Session made", local)]
    if site.name:
        found.append(("Place", site.name))
    if site.latitude_deg is not None and site.longitude_deg is not None:
        found.append(("Position", f"{site.latitude_deg:.4f}°, {site.longitude_deg:.4f}° (north, east)"))
    for device in session.devices:
        parts = (device.model, device.lens, device.nd_filter, "simulated" if device.simulated else "")
        found.append((device.role.capitalize(), ", ".join(part for part in parts if part)))
    return tuple(found)


def _summary(facts: Mapping[str, Any]) -> tuple[Quantity, ...]:
    room = facts["indoor"]
    if not room.get("absolute", True):
        return (Quantity("Clipped", round(100 * room["clipped_share"], 2), "% of all directions", note=room["source"]),)
    lux = room["illuminance_lx"]
    where = "At the eye" if "eye" in lux else "Horizontal illuminance indoors, at the camera"
    light = lux.get("eye") or lux["up"]
    found = [
        Quantity("k1", room["k1"], "", room["k1"] * room["k1_relative_uncertainty"], "indoor scale, eq. 1"),
        Quantity(where, light["value"], "lx", light["uncertainty"]),
    ]
    if sky := facts.get("outdoor"):
        relative = sky.get("k2_relative_uncertainty")
        uncertainty = None if relative is None else sky["k2"] * relative
        level = sky["illuminance_lx"]["up"]
        found += [
            Quantity("k2", sky["k2"], "", uncertainty, f"outdoor scale, eq. 2; {sky['k2_source']}"),
            Quantity("Horizontal illuminance outdoors", level["value"], "lx", level["uncertainty"]),
        ]
    return tuple(found)


def _shape(context: StageContext) -> tuple[Quantity, ...]:
    """Return the room's size, as people ask for it."""
    room: RoomModel | None = context.optional_artifact("room", "room")
    if room is None:
        return ()
    height = f"{room.ceiling_height_m:.2f} m high, {len(room.openings)} windows and doors"
    return (Quantity("Floor", round(floor_area_m2(room), 2), "m²", note=height),)


def _stage_line(name: str, summary: Mapping[str, Any]) -> StageLine:
    if reason := summary.get("skipped"):
        return StageLine(name, "skipped", str(reason))
    left_out = [f"left out {what}: {why}" for what, why in summary["left_out"].items() if why != NO_SUCH]
    honoured = [f"{what}: {how}" for what, how in summary["honoured"].items()]
    return StageLine(name, "ran", "; ".join([*honoured, *left_out]))


def _sections(context: StageContext, facts: Mapping[str, Any]) -> tuple[Section, ...]:
    response = context.optional_artifact("merge", "response") or {}
    metrics = context.summary("merge").get("metrics", {})
    indoor = context.artifact("calibrate", "indoor")
    display = display_in(context, indoor.rgb)
    found = [calibration_sections.indoor_section(indoor, facts["indoor"], display)]
    if context.has("calibrate", "outdoor"):
        found.append(
            calibration_sections.outdoor_section(context.artifact("calibrate", "outdoor"), facts["outdoor"], display)
        )
    figures = context.optional_artifact("figures", "light_figures")
    if figures is not None:
        found.append(calibration_sections.light_figures_section(figures))
    found += _room(context, display)
    found += _detect(context, display)
    found += _remove(context, display)
    for side in Side:
        if side.value in response:
            taken = context.session_path, context.session.pictures(side)
            found.append(calibration_sections.camera_section(side, response[side.value], metrics[side.value], taken))
    return tuple(found)


def _room(context: StageContext, display: Display) -> list[Section]:
    room: RoomModel | None = context.optional_artifact("room", "room")
    if room is None:
        return []
    summary = context.summary("room")
    return [room_section(upright_panorama(context), room, summary["metrics"], summary["left_out"], display)]


def _detect(context: StageContext, display: Display) -> list[Section]:
    target = context.optional_artifact("detect", "target")
    if target is None:
        return []
    masks = {name: context.optional_artifact("detect", name) for name in TINTS} | {"target": target}
    there = {name: mask for name, mask in masks.items() if mask is not None}
    return [detect_section(upright_panorama(context), there, context.summary("detect")["metrics"], display)]


def _remove(context: StageContext, display: Display) -> list[Section]:
    after = context.optional_artifact("remove", "empty")
    if after is None:
        return []
    filled, lift = context.artifact("remove", "filled"), context.optional_artifact("remove", "lift")
    log_lift = None
    if lift is not None:
        with np.load(lift) as kept:
            log_lift = kept["log_luminance"].astype(np.float32)
    return [remove_section(after, filled, context.summary("remove")["metrics"], log_lift, display)]


def _files(context: StageContext, unit: str) -> tuple[FileLine, ...]:
    return tuple(
        FileLine(f"stages/{stage}/{name}", path.stat().st_size, what.replace("cd/m2", unit))
        for (stage, name), what in FILES.items()
        if (path := context.session_path / "stages" / stage / name).exists()
    )
