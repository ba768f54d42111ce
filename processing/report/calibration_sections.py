"""Sections of the report on what was measured: calibrated pictures, cameras, illuminance, glare."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from processing.calibration.response.curve import fit_text
from processing.errors import ParameterError
from processing.ground.arrays import Bytes
from processing.ground.colour import srgb_of_linear
from processing.pictures.display import AS_GIVEN, Display
from processing.pictures.false_colour import validity_overlay
from processing.pictures.frames import frame_of
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.pictures.mosaic import FULL, PEDESTAL
from processing.pictures.preview import jpeg_bytes
from processing.report import plots
from processing.report.data import Picture, Quantity, Section, Table, number_text
from processing.sphere import Equirectangular
from station.session.session import FrameRecord, Side, shutter_label

SPOT_RAD = math.radians(1 / 3)
ANYWHERE_DEG = 180.0  # uncertainty of a north that nobody knows


def indoor_section(image: LuminanceImage, facts: Mapping[str, Any], display: Display = AS_GIVEN) -> Section:
    """Return the room: how it looks, its luminance, how sure that is, and where the scale is from."""
    parts = ", ".join(f"{name} {100 * value:.2f} %" for name, value in facts["k1_parts"].items())
    target = facts["target"]
    name = "Room" if isinstance(image.geometry, Equirectangular) else "At the eye"
    pictures = _pictures(image, name, display)
    if "longitude_deg" in target and isinstance(image.geometry, Equirectangular):
        pictures.append(_spot(image, image.geometry, target))
    quantities = []
    if facts["k1"] is not None:
        note = f"uncertainty from {parts}"
        quantities.append(Quantity("k1", facts["k1"], "", facts["k1"] * facts["k1_relative_uncertainty"], note))
    if facts["meter_cd_m2"]:
        quantities.append(Quantity("Meter reading at capture", facts["meter_cd_m2"], "cd/m2"))
    if facts["meter_drift_frac"] is not None:
        quantities.append(Quantity("Drift between the readings", 100 * facts["meter_drift_frac"], "%"))
    text = f"Target: {target['source']}. Vignetting: {facts['falloff']}."
    text += f" Lens: {_lens(facts['lens'])}." if "lens" in facts else ""
    text += f" Veiling glare: {_veil(facts['veil'])}." if "veil" in facts else ""
    return Section(name, text, tuple(quantities), tuple(pictures))


def outdoor_section(image: LuminanceImage, facts: Mapping[str, Any], display: Display = AS_GIVEN) -> Section:
    """Return the sky: the same, and lens, filter, north and sun."""
    lens, north, veil = facts["lens"], facts["north"], facts["veil"]
    rows = (
        ("Lens", _lens(lens)),
        ("Vignetting", facts["falloff"]),
        ("ND filter colour", facts["nd_colour"]),
        ("Veiling glare", _veil(veil)),
        ("North", _north(north)),
        ("Sun", f"{facts['sun']['found']}; repair: {facts['sun']['repair']}"),
    )
    tables = (Table("Corrections to the sky picture", ("step", "what was done"), rows),)
    return Section("Sky", "", (), tuple(_pictures(image, "Sky", display.exposed(image.rgb))), tables)


def _lens(lens: Mapping[str, Any]) -> str:
    return f"{lens['mapping']}, field {lens['field_deg']:.1f}°; {lens['source']}"


def _north(north: Mapping[str, Any]) -> str:
    if north["uncertainty_deg"] >= ANYWHERE_DEG:
        return "unknown: the picture's top is taken as north"
    return f"by the {north['source']}, within {north['uncertainty_deg']:.2f}°"


def camera_section(
    side: Side, response: Mapping[str, Any], metrics: Mapping[str, Any], taken: tuple[Path, Sequence[FrameRecord]]
) -> Section:
    """Return a camera's response curve, its fit's residuals, its frames and what each of them served."""
    curve = response["curve"]
    folder, frames = taken
    log2_exposure, sigma = np.array(curve["log2_exposure"]), np.array(curve["sigma_log2"])
    curves = plots.response_plot(log2_exposure, sigma, curve["low"], curve["high"])
    shows = f"response curves of the {side} camera by channel"
    note = f"{curve['method']}, {response['source']}; robust rms residual {curve['residual_stops']:.3f} stops; "
    pictures = [Picture("Response curve", curves, shows, note + fit_text(curve))]
    if residuals := response["residuals"]:
        rms = np.array([[math.nan if v is None else v for v in channel] for channel in residuals["rms_stops"]])
        drawn = plots.residual_plot(np.array(residuals["codes"]), rms)
        shows = f"how far frames of the {side} camera disagree on the same light, by code"
        pictures.append(Picture("Residuals of the fit", drawn, shows))
    ordered = sorted(frames, key=lambda frame: (-frame.camera_s, frame.stop))
    labels = [shutter_label(frame.camera_s) for frame in ordered]
    shares = [float(frame["used_share"]) for frame in metrics["frames"]]
    bars = plots.frame_usage_plot(labels, shares, [share == 0 for share in shares])
    pictures.append(Picture("Use of each frame", bars, "bars"))
    thumbnails = [thumbnail(folder / frame.file) for frame in ordered]
    sheet = plots.contact_sheet(thumbnails, labels)
    pictures.append(Picture("Bracket", sheet, f"frames of the {side} bracket, histograms", wide=True))
    text = f"Exposure times: {response['times_source']}."
    if (error := metrics.get("error95")) is not None:
        text += f" For 95 % of pixels the uncertainty is {error:.1%} (k = 1.96) or better."
    return Section(f"Camera {side}", text, pictures=tuple(pictures))


def thumbnail(path: Path) -> Bytes:
    """Return a frame, of shape (h, w, 3), at an eighth of its size, linear ones by the sRGB curve."""
    frame = frame_of(path, coded=True)
    codes = frame.decode(8)
    if codes.dtype == np.uint8:
        return np.asarray(codes, np.uint8)
    colours = getattr(frame, "colours", None)
    light = np.asarray(codes, np.float32) / np.float32(FULL)
    return srgb_of_linear(light if colours is None else (light - PEDESTAL / FULL) @ colours.matrix.T)


def _pictures(image: LuminanceImage, name: str, display: Display) -> list[Picture]:
    rows = plots.every_nth(image.rgb)
    rgb, wide = image.rgb[rows, rows], isinstance(image.geometry, Equirectangular)
    small, unit = display.shown(rgb), image.unit if image.absolute else "relative"
    bright = plots.luminance_picture(luminance_cd_m2(rgb), unit)
    doubt = plots.uncertainty_map(image.uncertainty)
    note = f"per pixel; the common scale adds {100 * image.scale_uncertainty:.2f} %"
    found = [
        Picture(name, jpeg_bytes(small), f"{name}, tone-mapped for display", wide=wide),
        Picture(f"{name}: luminance", bright, "false colours of luminance", wide=wide),
        Picture(f"{name}: relative standard uncertainty", doubt, "false colours of uncertainty", note, wide=wide),
        Picture(f"{name}: correlated colour temperature", plots.cct_picture(rgb), "false colours of CCT", wide=wide),
    ]
    if (image.validity != 0).any() or (image.ghost is not None and (image.ghost != 0).any()):
        ghost = None if image.ghost is None else image.ghost[rows, rows]
        overlay = validity_overlay(small, image.validity[rows, rows], ghost)
        found.append(Picture(f"{name}: validity", jpeg_bytes(overlay), "clipped, dark, repaired, moved", wide=wide))
    return found


def _spot(image: LuminanceImage, geometry: Equirectangular, target: Mapping[str, Any]) -> Picture:
    x = (target["longitude_deg"] / 360 + 0.5) * geometry.width_px
    y = (0.5 - target["latitude_deg"] / 180) * geometry.height_px
    radius_px = SPOT_RAD / 2 / (2 * math.pi) * geometry.width_px
    return Picture("Meter target", plots.spot_picture(image.rgb, (x, y), radius_px), "the target and the meter's spot")


def _veil(veil: Mapping[str, Any]) -> str:
    if veil["taken_off"]:
        return f"{100 * veil['index']:.2f} % of the mean light, subtracted"
    return f"not subtracted: {veil['why']}"


# The rose of light: how much falls on upright planes, by the direction they face.


def illuminance_rose(values: Sequence[float], unit: str) -> bytes:
    """Return an SVG of values (0 or more) evenly around from straight ahead, clockwise as seen from above."""
    if not values or not all(math.isfinite(value) and value >= 0 for value in values):
        raise ParameterError("a rose shows one value or more, all finite and from 0")
    figure = plots.empty_figure(4.6, 4.6)
    axes: Any = figure.add_subplot(projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    angles = 2 * np.pi * np.arange(len(values)) / len(values)
    axes.bar(angles, values, width=0.92 * 2 * np.pi / len(values), color="#2f5d50", alpha=0.85, linewidth=0)
    axes.set_xticks(np.pi / 2 * np.arange(4), ("ahead", "right", "back", "left"))
    axes.set_ylim(0, max(values) * 1.05 or 1.0)
    axes.tick_params(axis="y", labelsize=8, colors="#5c6269")
    axes.set_rlabel_position(22.5)
    axes.spines["polar"].set_visible(False)
    axes.grid(linewidth=0.4, alpha=0.6)
    axes.set_title(unit, fontsize=9, color="#5c6269", loc="right")
    return plots.svg_bytes(figure)


_AROUND = ("ahead", "ahead right", "right", "back right", "back", "back left", "left", "ahead left")
_INDICES = {"DGI": "dgi", "UGR": "ugr", "CGI": "cgi", "VCP (%)": "vcp_pct", "UGP": "ugp", "veil (cd/m²)": "lveil_cd_m2"}
_COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")


def light_figures_section(figures: Mapping[str, Any]) -> Section:
    """Return the figures of the stage of that name: illuminances with uncertainties, glare, statistics."""
    camera, units = figures["camera"], figures["units"]
    unit = units["illuminance"]
    quantities, pictures = [], tuple[Picture, ...]()
    if camera["level_up"] is not None:
        quantities.append(_quantity("Horizontal illuminance at the camera", camera["level_up"], unit))
        quantities.append(
            _quantity("Cylindrical illuminance", camera["cylindrical"], unit, "mean of all vertical planes")
        )
        rose = illuminance_rose([look["vertical"]["value"] for look in camera["directions"]], unit)
        pictures = (Picture("Vertical illuminance", rose, "rose of vertical illuminance by view direction"),)
    if outdoor := figures.get("outdoor"):
        quantities.append(_quantity("Horizontal illuminance outdoors", outdoor["level_up"], unit))
    if (ratio := figures.get("level_ratio")) is not None:
        percent = {**ratio, **{name: 100 * ratio[name] for name in ("value", "uncertainty")}}
        quantities.append(_quantity("Indoor to outdoor ratio", percent, "%", "daylight factor under an overcast sky"))
    looks = [(look, _name(look, k)) for k, look in enumerate(camera["directions"]) if "glare" in look]
    if looks:
        look, name = max(looks, key=lambda one: one[0]["glare"]["dgp"]["value"])
        text = f"{look['glare']['rating']}, looking {name}"
        quantities.append(_quantity("Highest daylight glare probability (DGP)", look["glare"]["dgp"], "", text))
    text = f"At the camera, {camera['height_m']:.2f} m above the floor. Uncertainties include the common scale."
    if not figures["absolute"]:
        text += " The picture has no absolute scale: values are relative, and glare cannot be computed."
    tables = [_directions_table(camera["directions"], unit), *_meter_table(figures.get("meter"))]
    tables.append(_surface_table(figures["surfaces"], units["luminance"]))
    return Section("Light and glare", text, tuple(quantities), pictures, tuple(tables))


def _quantity(name: str, figure: Mapping[str, Any], unit: str, note: str = "") -> Quantity:
    low = f"{figure['bound']} bound: part of the light is clipped or unseen" if figure["bound"] else ""
    return Quantity(name, figure["value"], unit, figure["uncertainty"], "; ".join(filter(None, (note, low))))


def _bounded(figure: Mapping[str, Any]) -> str:
    beyond = {"lower": " or more", "upper": " or less"}.get(figure["bound"], "")
    return number_text(figure["value"], figure["uncertainty"]) + beyond


def _name(look: Mapping[str, Any], number: int) -> str:
    name = _AROUND[number % len(_AROUND)]
    if look["compass_deg"] is None:
        return name
    return f"{name} ({_COMPASS[round(look['compass_deg'] / 45) % 8]}, {look['compass_deg']:.0f}°)"


def _directions_table(directions: Sequence[Mapping[str, Any]], unit: str) -> Table:
    glare = any("glare" in look for look in directions)
    head = ("looking", f"illuminance at the eye ({unit})", *(("DGP", "glare", "sources") if glare else ()))
    head += tuple(_INDICES) if "indices" in directions[0] else ()
    rows = []
    for k, look in enumerate(directions):
        row = [_name(look, k), _bounded(look["vertical"])]
        if glare:
            found = look["glare"]
            row += [
                _bounded(found["dgp"]),
                found["rating"] + (", little light" * found["faint"]),
                str(found["sources"]),
                *(_bounded(look["indices"][index]) for index in _INDICES.values() if "indices" in look),
            ]
        rows.append(tuple(row))
    return Table("By view direction", head, tuple(rows))


def _meter_table(meter: Mapping[str, Any] | None) -> list[Table]:
    if not meter:
        return []
    readings = ", ".join(number_text(value) for value in meter["readings_cd_m2"])
    difference = meter["difference_frac"]
    kind = "agree by construction: k1 comes from these readings" if meter["sets_scale"] else "a check: k1 was given"
    row = (f"{readings} cd/m²", f"{number_text(meter['picture_cd_m2'])} cd/m²")
    apart = "" if difference is None else f"{100 * difference:+.2f} %"
    return [Table("Meter and picture", ("meter", "picture there", "difference", "note"), ((*row, apart, kind),))]


def _surface_table(surfaces: Sequence[Mapping[str, Any]], unit: str) -> Table:
    head = ("part", f"mean ({unit})", "5 %", "median", "95 %", "highest", "clipped")
    names = ("mean", "p05", "median", "p95", "highest")
    rows = tuple(
        (str(one["name"]), *(_bounded(one[name]) for name in names), f"{100 * one['clipped_share']:.2g} %")
        for one in surfaces
    )
    return Table("Luminance of the room's parts", head, rows)
