"""A session as a row of the table: the paper's columns (cali_hdr_summary.csv), and what processing has found.

All is read from the session's folder: session.json and the results that stand. What is not known is empty. Values of
a picture without absolute scale are left empty where the column is in lx or cd/m2, and ``units`` says so.
"""

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, tzinfo
from pathlib import Path
from typing import Any

import numpy as np

from processing.batch.run import BatchReport
from processing.batch.work import Outcome
from processing.calibration.outdoor.sun_place import zone_at
from processing.errors import ResultFileError
from processing.ground.polygons import signed_area
from processing.ground.tables import table_of
from processing.pictures.writing import write_bytes
from processing.running.choices import read_choices
from station.session import strict_json
from station.session.session import SessionManifest, Side
from station.session.store import load_manifest

_COLUMNS: dict[str, list[str]] = table_of(__package__, "croissant")["columns"]
PAPER_COLUMNS, FOUND_COLUMNS = tuple(_COLUMNS["paper"]), tuple(_COLUMNS["found"])
_POINTS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
_MAX_JSON_BYTES = 8 << 20


def session_row(path: Path, named: str | None = None) -> dict[str, str]:
    """Return a session's row but for its index; times in the zone named, else the chosen one, else its place's.

    Raises `SessionError` for no session, `ResultFileError` for results of another form than stages write.
    """
    manifest = load_manifest(path)
    place = manifest.site.latitude_deg, manifest.site.longitude_deg
    zone = zone_at(*place, named or read_choices(path).value(path, "zone"))
    found = {
        "session": path.name,
        "session_id": manifest.session_id,
        "utc": f"{manifest.taken_utc:%Y-%m-%dT%H:%MZ}" if manifest.taken_utc else "",
        "zone": str(zone),
        "latitude_deg": _number(manifest.site.latitude_deg),
        "longitude_deg": _number(manifest.site.longitude_deg),
        "simulated": "YES" if manifest.simulated else "NO",
        "captured": manifest.status.value,
    }
    try:
        return found | _paper(manifest, path, zone) | _calibrated(path) | _light(path) | _room(path) | _staged(path)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        advice = f"daylit process {path} rebuilds them"
        raise ResultFileError(f"its results are damaged ({error!r})", where=str(path), advice=advice) from error


def _paper(manifest: SessionManifest, path: Path, zone: tzinfo) -> dict[str, str]:
    readings = [r.luminance_cd_m2 for r in manifest.readings if r.luminance_cd_m2 is not None]
    outdoor = [device for device in manifest.devices if device.role == "outdoor"]
    facts = stage_json(path, "calibrate", "calibration").get("outdoor", {})
    lux = facts.get("measured_outdoor_lux", {}).get("value", facts.get("illuminance_lx", {}).get("up", {}).get("value"))
    local = manifest.taken_utc and manifest.taken_utc.astimezone(zone)
    return {
        "date": f"{local:%Y%m%d}" if local else "",
        "scene_name": manifest.name,
        "theta_time": _begun(manifest, Side.INDOOR, zone) or (f"{local:%H:%M}" if local else ""),
        "luminance_cd_m2": f"{sum(readings) / len(readings):.2f}" if readings else "",
        "fisheye_time": _begun(manifest, Side.OUTDOOR, zone),
        "illuminance_lux": "" if lux is None else f"{lux:.0f}",
        "orientation": orientation(manifest.heading_rad),
        "nd_filter": ("YES" if outdoor[0].nd_filter else "NO") if outdoor else "",
        "natural_light": "",
    }


def _begun(manifest: SessionManifest, side: Side, zone: tzinfo) -> str:
    times: list[datetime] = [f.taken_utc for f in manifest.frames if f.side is side and f.taken_utc is not None]
    return f"{min(times).astimezone(zone):%H:%M}" if times else ""


def orientation(heading_rad: float | None) -> str:
    """Return a heading as the paper writes it: ``328°NW``; empty where it is not known."""
    if heading_rad is None:
        return ""
    degrees = round(math.degrees(heading_rad)) % 360
    return f"{degrees}°{_POINTS[round(degrees / 45) % 8]}"


def _calibrated(path: Path) -> dict[str, str]:
    facts = stage_json(path, "calibrate", "calibration")
    indoor, outdoor = facts.get("indoor", {}), facts.get("outdoor", {})
    return {
        "k1": _number(indoor.get("k1")),
        "k1_u_rel": _number(indoor.get("k1_relative_uncertainty")),
        "k2": _number(outdoor.get("k2")),
        "outdoor_lux_u": _number(outdoor.get("illuminance_lx", {}).get("up", {}).get("uncertainty")),
        "meter_drift_frac": _number(indoor.get("meter_drift_frac")),
    }


def _light(path: Path) -> dict[str, str]:
    figures = stage_json(path, "figures", "light_figures")
    metrics = stage_json(path, "figures", "result").get("metrics", {})
    if not figures:
        return {}
    found = {"units": figures["units"]["luminance"], "level_ratio": _number(metrics.get("level_ratio"))}
    if figures["absolute"]:
        found |= {
            "level_up_lx": _number(metrics.get("level_up")),
            "brightest_vertical_lx": _number(metrics.get("brightest_vertical")),
            "highest_dgp": _number(metrics.get("highest_dgp")),
        }
    return found


def _room(path: Path) -> dict[str, str]:
    room = stage_json(path, "room", "room")
    if not room:
        return {}
    corners = room["floor"]
    kinds = [opening["kind"] for opening in room.get("openings", ())]
    return {
        "room_confidence": _number(room.get("confidence")),
        "walls": str(len(corners)),
        "floor_m2": _number(signed_area(np.array(corners))),
        "ceiling_m": _number(room["ceiling_height_m"]),
        "windows": str(kinds.count("window")),
        "doors": str(kinds.count("door")),
    }


def _staged(path: Path) -> dict[str, str]:
    removed = stage_json(path, "detect", "result").get("metrics", {}).get("shares", {}).get("target")
    made = stage_json(path, "render", "result").get("artifacts", {})
    staged = sum(1 for name in made if name.startswith("staged-") and str(made[name]).endswith(".exr"))
    return {"removed_share": _number(removed), "staged": str(staged)}


def stage_json(path: Path, stage: str, name: str) -> dict[str, Any]:
    """Return a JSON artifact of a stage, or its result, as it stands; empty where there is none that can be read."""
    file = path / "stages" / stage / f"{name}.json"
    with suppress(OSError, ValueError):
        if file.stat().st_size <= _MAX_JSON_BYTES:
            found = strict_json.loads(file.read_bytes())
            return found if isinstance(found, dict) else {}
    return {}


def _number(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return ""
    return f"{value:.6g}"


# The table of a batch: batch.csv, a row a session in the paper's columns and more, and batch.json with all of it.

CSV_NAME, JSON_NAME = "batch.csv", "batch.json"
RUN_COLUMNS = ("state", "code", "message", "ran", "kept", "warnings", "tries", "seconds", "cpu_s", "peak_mb")
COLUMNS = (*PAPER_COLUMNS, *FOUND_COLUMNS, *RUN_COLUMNS)


def csv_text(columns: Sequence[str], rows: Iterable[Mapping[str, str]]) -> str:
    """Return rows as CSV, each text `guarded`; a column that a row lacks is empty."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, columns, lineterminator="\n", restval="")
    writer.writeheader()
    writer.writerows({name: guarded(value) for name, value in row.items()} for row in rows)
    return text.getvalue()


def table_row(index: int, one: Outcome) -> dict[str, str]:
    """Return a row of the table."""
    did = Counter(one.stages.values())
    found = {name: value for name, value in one.row.items() if name in COLUMNS}
    plain = {name: str(getattr(one, name)) for name in ("session", "state", "code", "message", "warnings", "tries")}
    return {
        **found,
        **plain,
        "index": str(index),
        "ran": str(did["ran"]),
        "kept": str(did["skipped"]),
        "seconds": f"{one.seconds:.2f}",
        "cpu_s": f"{one.cpu_seconds:.2f}",
        "peak_mb": f"{one.peak_bytes / 1e6:.0f}",
    }


def guarded(text: str) -> str:
    """Return text that no spreadsheet takes for a formula, and that stays on one line."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    number = plain.lstrip("+-").replace(".", "", 1).replace("e-", "", 1).replace("e+", "", 1).isdigit()
    return f"'{plain}" if plain[:1] in ("=", "+", "-", "@") and not number else plain


def write_table(folder: Path, report: BatchReport) -> tuple[Path, Path]:
    """Write batch.csv and batch.json into a folder, each whole or not at all, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    table, values = folder / CSV_NAME, folder / JSON_NAME
    rows = (table_row(index, one) for index, one in enumerate(report.outcomes, 1))
    write_bytes(table, csv_text(COLUMNS, rows).encode())
    write_bytes(values, (json.dumps(report.to_dict(), indent=1, allow_nan=False) + "\n").encode())
    return table, values
