"""A session's room under other light: what relighting and other viewpoints begin with, the basis kept beside the
session, each moment's picture and figures; and a day in pictures: a contact sheet with the times, an animation.
"""

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from processing.calibration.outdoor.sun_place import Place, sun_place
from processing.errors import DaylightError, ParameterError, ProcessingError, RelightError
from processing.exchange.jpeg_files import Made, packet
from processing.figures.figures import reduced
from processing.ground.arrays import Bytes, Floats, Vector
from processing.ground.room_model import read_json, read_room
from processing.layout.arrangement import Arrangement, Arrangements, PlacedItem
from processing.layout.models.catalogue import Catalogue
from processing.light.picture.relight_photo import photograph_under
from processing.light.picture.viewpoint import Elsewhere
from processing.light.scene.outdoor import outdoors_of
from processing.light.scene.scene import Outdoors, Scene
from processing.light.scene.scene_file import read_scene
from processing.light.solver.basis import LightBasis, basis_of, read_basis, scene_digest, write_basis
from processing.light.solver.irradiance import Effort
from processing.light.solver.relight import RelightView, Relit
from processing.light.solver.stage import Stage
from processing.pictures.display import Display
from processing.pictures.exr import read_exr
from processing.pictures.images import LUMINANCE_WEIGHTS, LuminanceImage, Validity
from processing.pictures.modes import modelled
from processing.pictures.writing import write_bytes, write_whole
from processing.running.artifacts import MAX_JSON_BYTES
from processing.sphere import Equirectangular, Perspective
from processing.stages.furnishing import furniture_parts
from station.session.session import SessionManifest, Side
from station.session.store import load_manifest

MEASURED = "outdoor picture"  # how materials says that the light outdoors was measured, not guessed
MODELLED = 0.15  # relative standard uncertainty of a picture in another light: albedo, windows, shape
SKY_MODEL = 0.15  # the same of what a modelled sky sends through a window
FOLDER = "relight"  # of a session: what relighting makes, and its stored basis
_WEIGHTS = np.asarray(LUMINANCE_WEIGHTS)
MARGIN_PX, TEXT_PX = 8, 22
FRAME_MS = 500  # chosen: half a second a picture
_INK, _PAPER = (30, 30, 34), (250, 250, 248)


@dataclass(frozen=True)
class SessionRoom:
    """A session's room, empty or staged."""

    manifest: SessionManifest
    scene: Scene
    """Under the captured light; with furniture where it is staged."""
    picture: LuminanceImage
    eye_m: Vector
    staged: int | None
    """The alternative's number; None: the emptied room."""
    outdoors_measured: bool

    @property
    def time_utc(self) -> datetime:
        """Return when the room was captured: the middle of its frames, else when the session was made."""
        return self.manifest.taken_utc or self.manifest.created_utc


def read_session_room(session: Path, staged: int | None, rows: int, furniture: Path | None = None) -> SessionRoom:
    """Return a session's room with its picture at ``rows`` rows; ``furniture``: the folder that it was staged from.

    Raises `RelightError` where the stages that are needed have not run, and what reading their files raises.
    """
    stages = session / "stages"
    manifest = load_manifest(session)
    scene_path = stages / "materials" / "scene.npz"
    if not scene_path.is_file():
        likely = "it was cleaned, or not processed so far; or without furniture (--set none), and it has no sun"
        advice = f"run: daylit process {session}; of one without furniture with --set auto"
        raise RelightError("the session has no scene", where=session.name, likely=likely, advice=advice)
    scene = read_scene(scene_path)
    facts = _json(stages / "materials" / "materials.json")
    height_m = read_room(stages / "room" / "room.json").camera_height_m
    if staged is not None:
        scene = _furnished(scene, stages, staged, furniture)
    picture = _picture(_picture_path(stages, staged), rows)
    return SessionRoom(
        manifest, scene, picture, (0.0, 0.0, height_m), staged, facts.get("outdoors", MEASURED) == MEASURED
    )


def _json(path: Path) -> dict[str, Any]:
    found = read_json(path, ProcessingError, MAX_JSON_BYTES)
    return found if isinstance(found, dict) else {}


def _picture_path(stages: Path, staged: int | None) -> Path:
    if staged is not None:
        return stages / "render" / f"staged-{staged}.exr"
    candidates = [stages / name for name in ("remove/empty.exr", "room/panorama.exr", "calibrate/indoor.exr")]
    return next((path for path in candidates if path.is_file()), candidates[-1])


def _furnished(scene: Scene, stages: Path, staged: int, furniture: Path | None) -> Scene:
    listing = stages / "render" / "staged.json"
    every = _json(listing).get("alternatives", []) if listing.is_file() else []
    if not 1 <= staged <= len(every):
        text = f"no staged alternative {staged}"
        advice = "give --staged 1 and up, or --empty"
        raise RelightError(text, where=stages.parent.name, likely=f"{len(every)} are rendered", advice=advice)
    files = _json(stages / "render" / "result.json").get("ingredients", {}).get("files", {})
    if bool(files.get("furniture")) != (furniture is not None):
        built_in = "leave --furniture out (saved option: daylit choices SESSION --forget furniture)"
        raise RelightError(
            "the furniture is from a folder of your own" if furniture is None else "the furniture is the built-in one",
            where=f"alternative {staged}",
            advice="give the same --furniture FOLDER as for daylit process" if furniture is None else built_in,
        )
    arrangements = Arrangements.model_validate_json(json.dumps(_json(stages / "arrange" / "arrangement.json")))
    return furnished(scene, arrangements.arrangements[staged - 1], every[staged - 1], furniture)


def furnished(scene: Scene, one: Arrangement, made: Mapping[str, Any], furniture: Path | None) -> Scene:
    """Return a scene with an alternative's pieces; ``made``: what the stage render says of it."""
    own = None if furniture is None else Catalogue.at(furniture)
    items = (*one.items, *(PlacedItem.model_validate(item) for item in made.get("added", ())))
    return scene.furnished(furniture_parts(items, Catalogue.builtin(made["style"]), own, lit=made.get("lamps") == "on"))


def _picture(path: Path, rows: int) -> LuminanceImage:
    """Return a panorama at ``rows`` rows, never more than it has."""
    image = read_exr(path)
    if not isinstance(image, LuminanceImage) or not isinstance(image.geometry, Equirectangular):
        raise RelightError("not a calibrated panorama", where=path.name, advice="process the session again")
    return reduced(image, 2 * rows)


def seen_picture(
    image: LuminanceImage, found: Elsewhere, geometry: Equirectangular | Perspective, eye_m: Vector
) -> LuminanceImage:
    """Return what is seen from ``eye_m`` of what ``image`` shows from the camera; what was rendered is doubted more."""
    return replace(
        image,
        rgb=found.rgb,
        uncertainty=np.where(found.seen, np.float32(0.1), np.float32(2 * MODELLED)),
        validity=np.full(found.seen.shape, Validity.VALID, np.uint8),
        geometry=geometry,
        ghost=None,
        attributes={**image.attributes, "seen_from_m": list(eye_m)},
    )


def check_sky(room: SessionRoom) -> None:
    """Raise `RelightError` where the light outdoors was not measured: the windows are then pictures that glow."""
    if not room.outdoors_measured:
        what, todo = "was captured", "capture the outdoor picture too"
        if any(frame.side is Side.OUTDOOR for frame in room.manifest.frames):
            what, todo = "is in cd/m2", "give its scale to daylit process: --calibration, --k2 or --outdoor-lux"
        text = f"no picture of the sky {what}, so the light of another sky through the windows is unknown"
        raise RelightError(text, where=room.manifest.name, advice=f"{todo}; daylit view-from works without")


def place_of(room: SessionRoom, site: Sequence[float] | None) -> Place:
    """Return where the room is; ``site``: latitude and longitude (degrees) instead of the session's."""
    here = Place.of(room.manifest.site) if site is None else Place(*site)
    if here is None:
        advice = "give --site LATITUDE,LONGITUDE (degrees, north and east positive)"
        raise DaylightError("the session's site is unknown", where=room.manifest.name, advice=advice)
    return here


def heading_of(room: SessionRoom, heading_rad: float | None, place: Place) -> tuple[float, str]:
    """Return the compass azimuth of the panorama's middle, and where it is known from."""
    if heading_rad is not None:
        return heading_rad, "given"
    if room.manifest.heading_rad is not None:
        return room.manifest.heading_rad, "session"
    sun = room.scene.outdoors.sun
    if sun is None:
        text = "the direction the panorama faces is unknown"
        likely = "no heading in the session, and no sun in its outdoor picture"
        advice = "give --heading DEGREES (compass azimuth of the panorama's centre)"
        raise DaylightError(text, where=room.manifest.name, likely=likely, advice=advice)
    compass = sun_place(room.time_utc, place).azimuth_rad
    return math.remainder(compass - math.atan2(sun.direction[0], sun.direction[1]), 2 * math.pi), "captured sun"


def other_sky(path: Path) -> Outdoors:
    """Return the light of a picture of the sky: one of ours, or anyone's HDR panorama (2 : 1) that states cd/m2."""
    from processing.figures.foreign import picture_of

    try:
        image = picture_of(path, None)
    except ParameterError as error:
        raise RelightError("a sky of unknown projection", where=path.name, advice="give a panorama, 2 to 1") from error
    if not image.absolute:
        advice = "give one in cd/m2: stages/calibrate has it; others' pictures need whiteLuminance"
        raise RelightError("a sky without an absolute scale", where=path.name, advice=advice)
    return outdoors_of(image)


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
        picture = modelled(picture, 0.0)
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


def display_of_day(display: Display, pictures: Sequence[Floats]) -> Display:
    """Return one display for pictures (H, W, 3) of a day, exposed for their brighter half: dusk looks darker."""
    if not pictures:
        raise ParameterError("no pictures")
    every = sorted(display.exposed(p).exposure for p in pictures)
    middle = float(np.exp(np.mean(np.log(every[: max(1, (len(every) + 1) // 2)]))))
    return display.brighter(middle / display.exposure)


def contact_sheet(pictures: Sequence[Bytes], captions: Sequence[str], foot: str = "", *, columns: int = 3) -> Bytes:
    """Return 8-bit pictures (H, W, 3) of one size in rows, each with its caption below; ``foot``: lines under all."""
    from PIL import Image, ImageDraw, ImageFont

    if not pictures or len(pictures) != len(captions):
        raise ParameterError("give as many captions as pictures, one at least")
    high, wide = pictures[0].shape[:2]
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    cell_w, cell_h = wide + MARGIN_PX, high + TEXT_PX + MARGIN_PX
    below = MARGIN_PX + (TEXT_PX * (1 + foot.count("\n")) if foot else 0)
    sheet = Image.new("RGB", (columns * cell_w + MARGIN_PX, rows * cell_h + below), _PAPER)
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(15)
    for number, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        x, y = MARGIN_PX + number % columns * cell_w, MARGIN_PX + number // columns * cell_h
        sheet.paste(Image.fromarray(np.ascontiguousarray(picture)), (x, y))
        pen.text((x + 2, y + high + 2), caption, fill=_INK, font=font)
    pen.text((MARGIN_PX + 2, rows * cell_h), foot, fill=_INK, font=font)
    return np.asarray(sheet, dtype=np.uint8)


def write_sheet(path: Path, pictures: Sequence[Bytes], captions: Sequence[str], made: Made) -> None:
    """Write a contact sheet of pictures (H, W, 3) as PNG, with what they are at its foot and in its XMP."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    whole, out, info = contact_sheet(pictures, captions, made.statement.replace(". ", ".\n")), io.BytesIO(), PngInfo()
    info.add_itxt("XML:com.adobe.xmp", packet(whole.shape[1], whole.shape[0], made=made).decode())
    Image.fromarray(whole).save(out, "PNG", pnginfo=info)
    write_bytes(path, out.getvalue())


def write_animation(path: Path, pictures: Sequence[Bytes], made: Made) -> None:
    """Write pictures (H, W, 3) as an animated WebP that repeats, with what they are in its XMP."""
    from PIL import Image

    frames = [Image.fromarray(np.ascontiguousarray(p)) for p in pictures]
    out = io.BytesIO()
    how: dict[str, Any] = {"duration": FRAME_MS, "loop": 0, "quality": 80, "xmp": packet(*frames[0].size, made=made)}
    frames[0].save(out, "WEBP", save_all=True, append_images=frames[1:], **how)
    write_bytes(path, out.getvalue())


def shrunk(rgb8: Bytes, rows: int) -> Bytes:
    """Return a picture (H, W, 3) of sRGB codes at most ``rows`` high, by area."""
    if rgb8.shape[0] <= rows:
        return rgb8
    size = (round(rgb8.shape[1] * rows / rgb8.shape[0]), rows)
    return np.asarray(cv2.resize(rgb8, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
