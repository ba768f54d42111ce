"""The report as one HTML file that needs nothing else: no fonts, no requests; to look around in, print and send.

Scripts are those of the widgets that the page has, each named in the page's policy by its digest: nothing else may run,
and nothing may be fetched but what is in the page itself.
"""

from __future__ import annotations

import base64
import hashlib
import io
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from processing.calibration.outdoor.sun_place import zone_at
from processing.exchange.jpeg_files import FURNITURE, removed_by
from processing.ground.room_model import RoomModel
from processing.ground.threads import side_by_side
from processing.report import data as report
from processing.report.sections import floor_area_m2
from processing.report.states import VIEWER_WIDTHS_PX, packed
from processing.stages.contract import StageContext
from processing.stages.upright import UNTRUSTED, trusted_parts
from station.session.session import SessionManifest

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
VIEWER = Path(__file__).parent / "static" / "viewer.js"
"""Of panoramas and models: built at set-up from ``studio/web``; without it pages say so, and stand."""


def build_page(data: report.ReportData) -> str:
    """Return the laboratory's page. Text is escaped, so that names from instruments and files stay text."""
    sections = [section for section in (data.lead, *data.sections) if section]
    widgets = [widget for section in sections for widget in section.widgets]
    return _rendered("report.html.j2", data, widgets, ("report.css", "widgets.css"))


def build_client_page(data: ClientData) -> str:
    """Return the client's page, likewise."""
    widgets = [widget for widget in (data.compared, data.tour, data.day) if widget is not None]
    return _rendered("client.html.j2", data, widgets, ("report.css", "widgets.css", "client.css"))


def _rendered(
    template: str, data: report.ReportData | ClientData, widgets: Sequence[report.Widget], styles: Sequence[str]
) -> str:
    environment = _environment()
    environment.filters |= {"size": report.size_text, "place": _place, "short": _short, "counted": _counted}
    environment.globals["viewer_built"] = VIEWER.exists()
    names = dict.fromkeys(name for widget in widgets for name in widget.scripts)
    scripts = [_source(name) for name in names if name != VIEWER.name or VIEWER.exists()]
    style = "\n".join(_source(name) for name in styles)
    return environment.get_template(template).render(data=data, style=style, scripts=scripts, policy=_policy(scripts))


def build_certificate(title: str, facts: Sequence[tuple[str, str]], data: Mapping[str, Any]) -> str:
    """Return the page of a certificate (`processing.figures.certificate`); ``facts``: label and text."""
    page = _environment().get_template("certificate.html.j2")
    return page.render(title=title, facts=facts, data=data, style=_source("report.css"), policy=_policy([]))


def _counted(cell: str) -> str:
    """Return a cell with walls and openings numbered from 1, as the page numbers them; files do from 0."""
    return re.sub(r"\b(wall|window|door|passage|opening|reveal)-(\d+)", lambda m: f"{m[1]} {int(m[2]) + 1}", cell)


def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(TEMPLATES)
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)


def _source(name: str) -> str:
    # Browsers read an ended line as "\n" before they take the digest.
    return (VIEWER if name == VIEWER.name else TEMPLATES / name).read_text("utf-8")


def _policy(scripts: list[str]) -> str:
    digests = [base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii") for text in scripts]
    rules = {
        "default-src": "'none'",
        "script-src": " ".join(f"'sha256-{digest}'" for digest in digests) or "'none'",
        "img-src": "data: blob:",
        "connect-src": "data: blob:",
        "style-src": "'unsafe-inline'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _place(value: float, ends: tuple[float, float]) -> str:
    """Return where a value stands on a logarithmic scale, per cent."""
    return f"{100 * math.log(value / ends[0]) / math.log(ends[1] / ends[0]):.2f}"


def _short(value: float) -> str:
    if 1e-3 <= value < 1e4:
        return f"{value:g}"
    power = math.floor(math.log10(value) + 1e-9)
    return f"{value / 10.0**power:g} × 10{str(power).translate(_RAISED)}"


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


# The page for a client: pictures, before and after, a tour, the plan with its measures, and files; nothing to learn. It
# says nothing that the run does not warrant: what was added or removed is said with each picture, beside the unaltered
# original, and a room whose shape is doubtful is called so.


PAGE_PX, PAGE_QUALITY = 1600, 80
"""Of stills within the page; the files beside it are larger. Chosen, with `TOUR_QUALITY`, for pages of 4 to 7 MB."""
ON_FLOOR_M = 0.1  # up to which a piece's underside is: rugs and plants are in the plan, lamps on tables are not; chosen
TOUR_QUALITY = 76  # chosen: below the 82 of lab.html, for fewer bytes
MOST_COMPARED = 3  # chosen: fits a page
MOST_TOUR = 5  # chosen: the page stays one that can be sent
DOUBTFUL = 0.5  # confidence of a room's shape below which the page says so: it is as likely wrong as right
STILLS = Path("..", "stills")  # where stills lie as seen from the page


@dataclass(frozen=True)
class Still(report.Embedded):
    """A framed picture on the page, with its statement and its files."""

    data: bytes
    """JPEG."""
    alt: str
    statement: str
    file: str
    """The full-size picture, relative to the page."""
    original: str
    """The unaltered photograph in the same frame; empty where this is it."""


@dataclass(frozen=True)
class ClientData:
    """All that the client's page shows."""

    title: str
    facts: tuple[tuple[str, str], ...]
    stills: tuple[Still, ...]
    notices: tuple[str, ...]
    """What a reader must know before trusting a picture."""
    compared: report.Comparison | None
    tour: report.Viewer | None
    plan: report.Picture | None
    measures: tuple[report.Quantity, ...]
    day: report.Cards | None
    downloads: tuple[tuple[str, str], ...]
    """File relative to the page, and what it is."""
    made_with: str


def client_data(context: StageContext, lab: report.ReportData) -> ClientData:
    """Return what the client's page shows, from the stills and what the laboratory's page gathered."""
    found = context.optional_artifact("stills", "stills") or {"stills": ()}
    folder = context.session_path / "stages" / "stills"
    made = partial(context.optional_artifact, "stills")  # fetched: the page is made anew where one of them is
    stills = [one for one in found["stills"] if all(made(Path(one[name]).stem) for name in ("file", "original"))]
    room: RoomModel | None = context.optional_artifact("room", "room")
    widgets = [widget for section in lab.sections for widget in section.widgets]
    viewers = [widget for widget in widgets if isinstance(widget, report.Viewer)]
    plan = _plan(context)
    days = [w for s in lab.sections if s.title == "Times of day" for w in s.widgets if isinstance(w, report.Cards)]
    return ClientData(
        title=context.session.site.name or context.session.name,
        facts=client_facts(context.session),
        stills=tuple(side_by_side(partial(_still, folder), stills)),
        notices=_notices(context, room, [one["state"] for one in stills]),
        compared=_compared(folder, stills),
        tour=_tour(viewers[0]) if viewers else None,
        plan=report.Picture("Plan", plan.read_bytes(), "") if plan else None,
        measures=() if room is None else _measures(room),
        day=_day([one.cards for one in days], _taken_local(context.session)),
        downloads=_downloads(context.session_path, stills, plan),
        made_with=lab.made_with,
    )


def client_facts(session: SessionManifest) -> tuple[tuple[str, str], ...]:
    """Return when and where a session was taken: label and text."""
    site, local = session.site, _taken_local(session)
    found = [("Photographed" if session.taken_utc else "Received", f"{local.day} {local:%B %Y, %H:%M %Z}")]
    if site.latitude_deg is not None and site.longitude_deg is not None:
        found.append(("Place", f"{site.latitude_deg:.4f}°, {site.longitude_deg:.4f}°"))
    return tuple(found)


def _taken_local(session: SessionManifest) -> datetime:
    zone = zone_at(session.site.latitude_deg, session.site.longitude_deg)
    return (session.taken_utc or session.created_utc).astimezone(zone)


def _still(folder: Path, one: Mapping[str, Any]) -> Still:
    edited = one["state"] != "photograph"
    shows = f" with {', '.join(name.replace('-', ' ') for name in one['shows'])}" if one["shows"] else ""
    return Still(
        _smaller((folder / one["file"]).read_bytes(), PAGE_PX),
        f"The room, {one['state'].replace('-', ' ')}{shows}",
        one["statement"].partition(" Unaltered original:")[0],
        (STILLS / one["file"]).as_posix(),
        (STILLS / one["original"]).as_posix() if edited else "",
    )


def _smaller(jpeg: bytes, width_px: int, quality: int = PAGE_QUALITY) -> bytes:
    """Return a JPEG at most so wide, with its XMP."""
    from PIL import Image

    with Image.open(io.BytesIO(jpeg)) as opened:
        size = (min(width_px, opened.width), round(opened.height * min(1.0, width_px / opened.width)))
        out = io.BytesIO()
        xmp = opened.info.get("xmp", b"")
        opened.resize(size, Image.Resampling.LANCZOS).save(out, "JPEG", quality=quality, subsampling=0, xmp=xmp)
    return out.getvalue()


def _notices(context: StageContext, room: RoomModel | None, states: list[str]) -> tuple[str, ...]:
    found = []
    if any(state.startswith("staged") for state in states):
        found.append("Pictures marked as virtually staged show furniture that is not in the room.")
    if removed := removed_by(context.summary("remove")):
        what = (
            "The room's own furniture" if removed == FURNITURE else "The photographer's equipment, or direct sunlight,"
        )
        found.append(f"{what} was removed digitally: what it hid is computed, not photographed.")
    if room is not None and room.source == "estimated" and room.confidence < DOUBTFUL:
        found.append(f"The room's shape is doubtful (confidence {room.confidence:.0%}){_meaning(context, *found)}")
    return tuple(found)


def _meaning(context: StageContext, *done: str) -> str:
    """Return what a doubtful shape means, by what was left undone for it and by the sentences on what was done."""
    stages = {"emptied": "remove", "staged": "materials"}
    undone = [what for what, one in stages.items() if "doubtful" in str(context.summary(one).get("skipped", ""))]
    undone = ["emptied as a whole"] * (UNTRUSTED in context.summary("remove")["left_out"]) + undone
    if undone:
        text = f"{'neither' if len(undone) > 1 else 'not'} {' nor '.join(undone)}"
        return f", and it was {text}: {trusted_parts(context)} can be trusted; other measurements may be wrong."
    stands = " and the positions of furniture" if any("staged" in text for text in done) else ""
    return f": measurements{stands} may be wrong."


def _compared(folder: Path, stills: list[Any]) -> report.Comparison | None:
    """Return original and result of the best frames of one state under a slider; None where nothing was changed."""
    edited = [one for one in stills if one["state"] != "photograph"]
    same = [one for one in edited if one["state"] == edited[0]["state"]][:MOST_COMPARED]
    if not same:
        return None
    after = same[0]["state"].replace("-", " ").capitalize()
    scenes = []
    for number, one in enumerate(same, 1):
        pictures = [_smaller((folder / one[name]).read_bytes(), 1280) for name in ("original", "file")]
        tag = f"{after}: virtual" if after.startswith("Staged") else after
        shots = (
            report.Shot("Original", pictures[0], f"View {number}: the room as photographed"),
            report.Shot(after, pictures[1], f"View {number}: {one['statement']}", tag),
        )
        scenes.append(report.Scene(f"View {number}", shots, 1280, 1280 * 2 // 3))
    return report.Comparison(tuple(scenes), "Original", after)


def _tour(lab: report.Viewer) -> report.Viewer:
    """Return the viewer with fewer bytes of panoramas, and without the maps of its probe."""
    some = sorted(lab.states[:MOST_TOUR], key=lambda state: not state.staged)  # what was ordered comes first
    nothing, unknown = packed(np.zeros((1, 2), np.uint16)), packed(np.zeros((1, 2), np.uint8))

    def smaller(state: report.ViewerState) -> report.ViewerState:
        jpeg = _smaller(state.jpeg, VIEWER_WIDTHS_PX[0][1], TOUR_QUALITY)
        return replace(state, jpeg=jpeg, luminance=nothing, uncertainty=unknown, validity=unknown, map_px=(2, 1))

    return replace(lab, states=tuple(side_by_side(smaller, some)))


def _day(parts: Sequence[Sequence[report.Card]], taken: datetime) -> report.Cards | None:
    """Return the moments of one day, state and weather of which there are most: swept ones first, else a run's own.

    A title is "2023-06-21 09:00, staged 1"; another sky is no moment of a day. The first shown is the nearest to the
    hour of the photograph, whose light the pictures above have."""
    found = None
    for cards in parts:
        kinds = [(one.title[:10], one.title[16:], one.text) for one in cards]
        days = Counter(kind for kind in kinds if kind[0][:1].isdigit())
        (most, count), *_ = days.most_common(1) or [(("", "", ""), 0)]
        same = [one for one, kind in zip(cards, kinds, strict=True) if kind == most]
        if same and (found is None or len(found.cards) == 1 < count):
            hours = sorted(same, key=lambda one: one.title)
            away = [abs(60 * int(c.title[11:13]) + int(c.title[14:16]) - 60 * taken.hour - taken.minute) for c in hours]
            found = report.Cards(tuple(hours), ("day.js",), away.index(min(away)))
    return found


def _measures(room: RoomModel) -> tuple[report.Quantity, ...]:
    doubt = " (estimated from the picture)" if room.source == "estimated" else ""
    scale = f"scale: camera {room.camera_height_m:g} m high"
    lengths = " · ".join(f"{room.wall_length_m(k):.2f}" for k in range(len(room.floor)))
    return (
        report.Quantity("Floor", round(floor_area_m2(room), 1), "m²", note=scale),
        report.Quantity("Ceiling", round(room.ceiling_height_m, 2), "m", note=f"height{doubt}"),
        report.Quantity("Walls", len(room.floor), "", note=f"{lengths} m"),
        report.Quantity("Windows and doors", len(room.openings), ""),
    )


def _plan(context: StageContext) -> Path | None:
    """Write the floor plan of the first alternative, with what dresses its floor; None where nothing was arranged."""
    from processing.layout.arrangement import PlacedItem
    from processing.layout.drawn.canvas import write_sheet
    from processing.layout.drawn.drawing import floor_plan
    from processing.layout.plan_files import plan_from_mapping

    found = context.optional_artifact("arrange", "arrangement")
    if found is None or not found.arrangements:
        return None
    first = found.arrangements[0]
    staged = context.optional_artifact("render", "staged") or {"alternatives": ()}
    added = [PlacedItem(**one) for a in staged["alternatives"] if a["rank"] == first.rank for one in a.get("added", ())]
    standing = (one for one in added if one.t_m[2] < ON_FLOOR_M)
    vector, raster = write_sheet(
        floor_plan(plan_from_mapping(found.plan, where="plan"), [*first.items, *standing]), context.folder / "plan"
    )
    raster.unlink()
    return vector


def _downloads(session: Path, stills: list[Any], plan: Path | None) -> tuple[tuple[str, str], ...]:
    found = [((STILLS / one["file"]).as_posix(), f"picture {k}, full size") for k, one in enumerate(stills, 1)]
    if (session / "stages" / "render" / "staged-1.glb").is_file():
        found.append(("../render/staged-1.glb", "3D model (glTF)"))
    if plan is not None:
        found.append((plan.name, "plan"))
    return (*found, ("lab.html", "technical report: figures, uncertainties and methods"))
