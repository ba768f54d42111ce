"""A session's room under other light: the basis kept beside the session, and each moment's picture and figures.

A day in pictures: a contact sheet with the times, and an animation.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Any

import numpy as np

from processing.calibration.outdoor.sun_place import Place, sun_place
from processing.errors import DaylightError, ParameterError, RelightError
from processing.ground.arrays import Bytes, Floats
from processing.light.picture.relight_photo import photograph_under
from processing.light.scene.scene import Outdoors
from processing.light.solver.basis import LightBasis, basis_of, read_basis, scene_digest, write_basis
from processing.light.solver.irradiance import Effort
from processing.light.solver.relight import RelightView, Relit
from processing.light.solver.stage import Stage
from processing.pictures.display import Display
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.pictures.writing import write_bytes, write_whole
from processing.relighting.session_room import MODELLED, SKY_MODEL, SessionRoom
from processing.relighting.weather import Daylight, level_illuminance

FOLDER = "relight"
"""Of a session: what relighting makes, and its stored basis."""
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)


@dataclass(frozen=True)
class RelitRoom:
    """A room in another light."""

    picture: LuminanceImage
    facts: dict[str, Any]


class Relighting:
    """A session's room ready for any light outdoors."""

    def __init__(self, room: SessionRoom, folder: Path, effort: Effort) -> None:
        """``folder``: where the basis is kept."""
        self.room = room
        stage = Stage.of(room.scene, effort.texel_m)
        basis, self.basis_kept = _basis(stage, room, folder, effort)
        self.view = RelightView(stage, basis, room.picture.rgb.shape[0])
        self.before = self.view.relit(room.scene.outdoors)

    def under(self, outdoors: Outdoors, said: dict[str, Any], *, modelled_sky: bool = True) -> RelitRoom:
        """Return the room under another light outdoors; ``said`` goes into its facts and the picture's attributes.

        ``modelled_sky``: its light is a model's guess, not measured; the uncertainty says so.
        """
        image = self.room.picture
        found, after = photograph_under(image.rgb, self.view, self.before, outdoors)
        sky = SKY_MODEL if modelled_sky else 0.0
        doubt = np.hypot(np.where(found.detail > 0.5, MODELLED, 2 * MODELLED), math.hypot(sky, after.error))
        picture = replace(
            image,
            rgb=found.rgb,
            uncertainty=np.hypot(np.minimum(image.uncertainty, np.float32(1)), doubt).astype(np.float32),
            validity=np.full(found.detail.shape, Validity.VALID, np.uint8),
            ghost=None,
            attributes={**image.attributes, "relit": said},
        )
        return RelitRoom(picture, said | self._facts(after, picture, found.detail))

    def _facts(self, after: Relit, picture: LuminanceImage, detail: np.ndarray) -> dict[str, Any]:
        solid = self.view.full.solid.reshape(detail.shape)
        level = picture.rgb @ _WEIGHTS
        sunny = (after.sun @ _WEIGHTS > 0) & solid
        return {
            "uncertainty": round(float(np.median(picture.uncertainty[solid])), 3) if solid.any() else 0.0,
            "error_of_rays": round(after.error, 4),
            "median_luminance": round(float(np.median(level[solid])), 3) if solid.any() else 0.0,
            "sunny_share": round(float(sunny[solid].mean()), 5) if solid.any() else 0.0,
            "detail_kept_share": round(float(detail[solid].mean()), 4) if solid.any() else 0.0,
            "unit": self.room.picture.unit,
        }


def _basis(stage: Stage, room: SessionRoom, folder: Path, effort: Effort) -> tuple[LightBasis, bool]:
    """Return the stored basis of this scene and effort, or a new one, stored; and whether it was there."""
    digest = scene_digest(stage)
    path = folder / f"basis-{digest[:16]}-{effort.rows}.npz"
    if path.is_file():
        try:
            basis = read_basis(path)
        except RelightError:
            path.unlink()
        else:
            if basis.scene_digest == digest and basis.effort == effort and basis.eye_m == room.eye_m:
                return basis, True
    basis = basis_of(stage, room.eye_m, effort=effort)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(path, lambda part: write_basis(part, basis))
    return basis, False


def daylight_facts(found: Daylight, time_utc: datetime) -> dict[str, Any]:
    """Return a moment's light as plain values."""
    return {
        "time_utc": time_utc.isoformat(timespec="minutes"),
        "sun_azimuth_deg": round(math.degrees(found.place.azimuth_rad) % 360, 3),
        "sun_elevation_deg": round(math.degrees(found.place.elevation_rad), 3),
        "sun_normal_lx": round(found.normal_lx, 1),
        "sky_horizontal_lx": round(found.diffuse_lx, 1),
        "global_horizontal_lx": round(found.global_lx, 1),
        "clearness": round(found.clearness, 3),
    }


def sky_facts(outdoors: Outdoors) -> dict[str, Any]:
    """Return the light of a given sky as plain values."""
    sky, sun = (float(v @ _WEIGHTS) for v in level_illuminance(outdoors))
    found: dict[str, Any] = {"sky_horizontal_lx": round(sky, 1), "global_horizontal_lx": round(sky + sun, 1)}
    if outdoors.sun is not None:
        x, y, z = outdoors.sun.direction
        found["sun_from_middle_deg"] = round(math.degrees(math.atan2(x, y)), 3)
        found["sun_elevation_deg"] = round(math.degrees(math.asin(z)), 3)
    return found


def parse_time(text: str, zone: tzinfo) -> datetime:
    """Return a time of ISO 8601 in UTC; one without a zone is as clocks in ``zone`` show it."""
    try:
        found = datetime.fromisoformat(text.strip())
    except ValueError as error:
        raise DaylightError(
            f"no time: {text!r}", advice='say "2023-06-21 16:00", or with a zone: …T16:00+02:00'
        ) from error
    return (found.replace(tzinfo=zone) if found.tzinfo is None else found).astimezone(UTC)


def day_times(day: datetime, place: Place, zone: tzinfo, step: timedelta) -> list[datetime]:
    """Return the times of a local day, whole steps from midnight, at which the sun is at least 1 degree high."""
    if not timedelta(minutes=5) <= step <= timedelta(hours=6):
        raise DaylightError(f"a step of {step}", advice="give 5 minutes to 6 hours, such as 30m or 1h")
    midnight = day.astimezone(zone).replace(hour=0, minute=0, second=0, microsecond=0).astimezone(UTC)
    times = [midnight + k * step for k in range(math.ceil(timedelta(days=1) / step))]
    found = [t for t in times if sun_place(t, place).elevation_rad > math.radians(1.0)]
    if not found:
        raise DaylightError(
            "the sun does not rise that day", where=day.date().isoformat(), advice="give another --date"
        )
    return found


MARGIN_PX, TEXT_PX = 8, 22
FRAME_MS = 500
_INK, _PAPER = (30, 30, 34), (250, 250, 248)


def display_of_day(display: Display, pictures: Sequence[Floats]) -> Display:
    """Return one display for pictures (H, W, 3) of a day, exposed for their brighter half: dusk looks darker."""
    if not pictures:
        raise ParameterError("no pictures")
    every = sorted(display.exposed(p).exposure for p in pictures)
    middle = float(np.exp(np.mean(np.log(every[: max(1, (len(every) + 1) // 2)]))))
    return display.brighter(middle / display.exposure)


def contact_sheet(pictures: Sequence[Bytes], captions: Sequence[str], *, columns: int = 3) -> Bytes:
    """Return 8-bit pictures (H, W, 3) of one size in rows, each with its caption below."""
    from PIL import Image, ImageDraw, ImageFont

    if not pictures or len(pictures) != len(captions):
        raise ParameterError("give as many captions as pictures, one at least")
    high, wide = pictures[0].shape[:2]
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    cell_w, cell_h = wide + MARGIN_PX, high + TEXT_PX + MARGIN_PX
    sheet = Image.new("RGB", (columns * cell_w + MARGIN_PX, rows * cell_h + MARGIN_PX), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for number, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        x, y = MARGIN_PX + number % columns * cell_w, MARGIN_PX + number // columns * cell_h
        sheet.paste(Image.fromarray(np.ascontiguousarray(picture)), (x, y))
        pen.text((x + 2, y + high + 2), caption, fill=_INK, font=font)
    return np.asarray(sheet, dtype=np.uint8)


def write_sheet(path: Path, pictures: Sequence[Bytes], captions: Sequence[str]) -> None:
    """Write a contact sheet of pictures (H, W, 3) as PNG."""
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(contact_sheet(pictures, captions)).save(out, "PNG")
    write_bytes(path, out.getvalue())


def write_animation(path: Path, pictures: Sequence[Bytes]) -> None:
    """Write pictures (H, W, 3) as an animated WebP that repeats."""
    from PIL import Image

    frames = [Image.fromarray(np.ascontiguousarray(p)) for p in pictures]
    out = io.BytesIO()
    frames[0].save(out, "WEBP", save_all=True, append_images=frames[1:], duration=FRAME_MS, loop=0, quality=80)
    write_bytes(path, out.getvalue())


def shrunk(rgb8: Bytes, rows: int) -> Bytes:
    """Return a picture (H, W, 3) of sRGB codes at most ``rows`` high, by area."""
    import cv2

    if rgb8.shape[0] <= rows:
        return rgb8
    size = (round(rgb8.shape[1] * rows / rgb8.shape[0]), rows)
    return np.asarray(cv2.resize(rgb8, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
