"""Sections of the report on what is to be removed, on the emptied room, and on the room's shape."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from processing.ground.arrays import Bytes, Flags, Floats, Int16s
from processing.ground.polygons import signed_area
from processing.ground.room_model import RoomModel
from processing.ground.tables import table_of
from processing.pictures.display import AS_GIVEN, Display
from processing.pictures.images import LuminanceImage
from processing.pictures.preview import jpeg_bytes
from processing.report.data import Picture, Quantity, Section, Table
from processing.report.plots import every_nth, plan_plot
from processing.sphere import Equirectangular
from processing.surfaces.maps import opening_map, plane_map

TINTS = {"furniture": (230, 40, 40), "tripod": (220, 0, 220), "sunlight": (250, 210, 0), "shadow": (40, 90, 240)}
"""sRGB by mask."""
_NAMES: dict[str, str] = table_of(__package__, "words")["masks"]
RIM_RGB = (0, 220, 60)
MOST_SHOWN = 0.5  # relative change of luminance at the ends of the colour scale; chosen
EDGE_RGB, OPENING_RGB = (0, 230, 90), (255, 170, 0)


def detect_section(
    image: LuminanceImage, masks: Mapping[str, Flags], facts: Mapping[str, Any], display: Display = AS_GIVEN
) -> Section:
    """Return the panorama with tinted masks, how much of the sphere each covers, and what was skipped.

    ``masks``: by name, (H, W) each, those that were found; ``facts``: the stage's metrics.
    """
    fitting = {name: mask for name, mask in masks.items() if mask.shape == image.rgb.shape[:2]}
    rows = every_nth(image.rgb)
    shown = tinted(display.shown(image.rgb[rows, rows]), {name: mask[rows, rows] for name, mask in fitting.items()})
    shares = facts.get("shares", {})
    quantities = [
        Quantity(text[0].upper() + text[1:], 100 * shares[name], "% of all directions")
        for name, text in _NAMES.items()
        if name in shares
    ]
    tables = []
    if notes := facts.get("notes"):
        tables.append(Table("Skipped, dropped or not found", ("note",), tuple((note,) for note in notes)))
    if "evidence" not in facts:
        text = "Given by the user."
    else:
        text = f"Segmentation: {facts['evidence']}"
        text += f"; {facts['views_skipped']} views skipped." if facts["views_skipped"] else "."
    picture = Picture("To be removed", jpeg_bytes(shown), "panorama with tinted masks", wide=True)
    return Section("Detection", text, tuple(quantities), (picture,), tuple(tables))


def tinted(rgb8: Bytes, masks: Mapping[str, Flags]) -> Bytes:
    """Return a picture (H, W, 3) sRGB with masks (H, W) in their colours, and a green line around the target."""
    out = rgb8.astype(np.float32)
    for name, colour in TINTS.items():
        if name in masks:
            out[masks[name]] = 0.5 * out[masks[name]] + 0.5 * np.array(colour, np.float32)
    if "target" in masks:
        out[_rim(masks["target"])] = RIM_RGB
    return np.asarray(np.clip(out, 0, 255), dtype=np.uint8)


def _rim(mask: Flags) -> Flags:
    """Return the pixels of a mask (H, W) of a panorama that have a neighbour outside of it."""
    inner = mask & np.roll(mask, 1, 1) & np.roll(mask, -1, 1)
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    return np.asarray(mask & ~inner)


def remove_section(
    after: LuminanceImage, filled: Flags, facts: Mapping[str, Any], lift: Floats | None = None, look: Display = AS_GIVEN
) -> Section:
    """Return the emptied panorama with what was filled and how.

    ``filled``: (H, W); ``facts``: the stage's metrics; ``lift`` (H, W): natural logarithm of what changed the
    luminance of each pixel that stayed, None: nothing did.
    """
    rows = every_nth(after.rgb)
    outlined = look.shown(after.rgb[rows, rows])
    outlined[_rim(filled[rows, rows])] = RIM_RGB
    pictures = [Picture("Filled areas", jpeg_bytes(outlined), "filled parts outlined in green", wide=True)]
    quantities = [
        Quantity("Filled", 100 * float(facts.get("filled_share", filled.mean())), "% of the picture"),
        Quantity("of which synthesised", 100 * float(facts.get("synthesised_share", 0.0)), "% of the picture"),
        Quantity("Mean confidence of the fill", float(facts.get("mean_confidence", 0.0)), ""),
    ]
    notes = facts.get("notes", [])
    tables = (Table("Surfaces", ("how it was filled",), tuple((note,) for note in notes)),) if notes else ()
    relit = float(facts.get("relit_share", 0.0))
    text = "Pixels outside the outlines are as captured"
    if lift is not None:
        text += ", relit without the furniture's shading."
        share = np.clip(np.expm1(lift[rows, rows]) / MOST_SHOWN, -1, 1)[..., None]
        towards = np.where(share > 0, np.array([178, 24, 43]), np.array([33, 102, 172]))
        as_colours = np.asarray(np.round(255 + (towards - 255) * np.abs(share)), np.uint8)
        note = f"brighter (red) or darker (blue) by up to {100 * MOST_SHOWN:.0f} % than captured"
        pictures.append(Picture("Shading removed", jpeg_bytes(as_colours), note, wide=True))
        quantities.append(Quantity("Median pixel brightened by", float(facts["lifted_median_pct"]), "%"))
    elif relit:
        text += f", except soft shadows of furniture ({relit:.1%} of all directions), brightened to match around."
    else:
        text += "."
    return Section("Emptied room", text, tuple(quantities), tuple(pictures), tables)


def room_section(
    image: LuminanceImage,
    room: RoomModel,
    facts: Mapping[str, Any],
    left_out: Mapping[str, str],
    display: Display = AS_GIVEN,
) -> Section:
    """Return the room as it was estimated or given; ``facts`` are the stage's metrics."""
    quantities = [
        Quantity("Floor", floor_area_m2(room), "m2"),
        Quantity("Ceiling height", room.ceiling_height_m, "m", note=f"camera at {room.camera_height_m:g} m: scale"),
        Quantity("Confidence", room.confidence, "", note="estimated probability of a 3D IoU of 0.85 or more"),
    ]
    if "tilt_deg" in facts:
        quantities.append(Quantity("Tilt of the panorama", facts["tilt_deg"], "degrees", facts.get("tilt_sigma_deg")))
    openings = [(o.kind.value, room.on_wall(o.wall, o.start_m), room.on_wall(o.wall, o.end_m)) for o in room.openings]
    pictures = (
        Picture("Layout", jpeg_bytes(drawn(image, room, display)), "panorama with its edges and openings", wide=True),
        Picture("Plan", plan_plot(room.floor, openings), "floor plan"),
    )
    source = "given by the user" if room.source == "given" else f"estimated from the panorama ({room.note})"
    text = f"The room is {source}. Segmentation: {facts.get('source', 'none')}."
    return Section("Room shape", text, tuple(quantities), pictures, _tables(room, facts, left_out))


def drawn(image: LuminanceImage, room: RoomModel, display: Display) -> Bytes:
    """Return a small panorama (H, W, 3) sRGB, edges of walls, floor and ceiling in green, of openings in orange."""
    rows = every_nth(image.rgb)
    rgb8 = display.shown(image.rgb[rows, rows])
    geometry = Equirectangular(rgb8.shape[1], rgb8.shape[0])
    plane, opening = plane_map(room, geometry), opening_map(room, geometry)
    out = rgb8.copy()
    out[_edges(opening)] = OPENING_RGB
    out[_edges(plane)] = EDGE_RGB
    return out


def _edges(labels: Int16s) -> Flags:
    edge = labels != np.roll(labels, 1, axis=1)
    edge[1:] |= labels[1:] != labels[:-1]
    return np.asarray(edge)


def _tables(room: RoomModel, facts: Mapping[str, Any], left_out: Mapping[str, str]) -> tuple[Table, ...]:
    sure = facts.get("wall_confidences", [])
    walls = tuple(
        (f"wall {i + 1}", f"{room.wall_length_m(i):.2f} m", f"{sure[i]:.2f}" if i < len(sure) else "-")
        for i in range(len(room.floor))
    )
    openings = []
    for i, o in enumerate(room.openings):
        along, height = f"{o.start_m:.2f} to {o.end_m:.2f} m", f"{o.sill_m:.2f} to {o.head_m:.2f} m"
        openings.append((f"{o.kind.value}-{i}", f"wall {o.wall + 1}", along, height, f"{o.confidence:.2f}"))
    found = [Table("Walls", ("wall", "length", "confidence"), walls)]
    if openings:
        found.append(Table("Openings", ("kind", "wall", "along it", "height", "confidence"), tuple(openings)))
    if left_out:
        found.append(Table("Not done", ("what", "why"), tuple((str(k), str(v)) for k, v in left_out.items())))
    return tuple(found)


def floor_area_m2(room: RoomModel) -> float:
    """Return the area of the floor."""
    return signed_area(np.array(room.floor))
