"""A session's results written for other programs: pictures, what an eye meets, and the room as a model.

Each file is written whole or not at all. What cannot be written is left out with the reason; the rest stands.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from processing.errors import ParameterError, PictureFileError, ProcessingError, ResultFileError
from processing.exchange.gltf import finely, write_scene_glb
from processing.exchange.jpeg_files import Made, PanoramaTags, write_jpeg
from processing.exchange.showing import Shown, made_of, photograph_of, session_shown
from processing.ground.finished import Finished
from processing.ground.room_model import read_room
from processing.light.scene.scene_file import read_scene
from processing.pictures.exr import read_exr, write_exr
from processing.pictures.images import LuminanceImage
from processing.pictures.patch import read_shown
from processing.pictures.radiance import write_radiance_hdr
from processing.pictures.writing import write_bytes
from processing.sphere import Equirectangular
from station.session.store import load_manifest

KINDS = ("jpeg", "hdr", "exr", "gltf")
ROOM, SKY, EMPTY = "room", "sky", "empty"
MOST_STAGED = 7  # as many as the pipeline makes (`pipeline.toml`)


@dataclass
class Exported:
    """What was written, and what was not and why."""

    files: list[Path] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)


def pictures_of(session: Path, left_out: dict[str, str]) -> dict[str, Path]:
    """Return the calibrated pictures that a session's results hold, by name: room, sky, empty, staged-1 ...

    ``left_out``: gets what is missing or damaged, and why.
    """
    every = [(ROOM, "calibrate", "indoor"), (ROOM, "room", "panorama")]  # the upright one, where there is one
    every += [(SKY, "calibrate", "outdoor"), (EMPTY, "remove", "empty")]
    every += [(f"staged-{n}", "render", f"staged-{n}") for n in range(1, MOST_STAGED + 1)]
    made = ((name, recorded(session, stage, f"{file}.exr", left_out)) for name, stage, file in every)
    return {name: path for name, path in made if path is not None}


def recorded(session: Path, stage: str, name: str, left_out: dict[str, str]) -> Path | None:
    """Return a file as its stage made it; None where it made none, or, named in ``left_out``, it is not there so."""
    what = stage
    try:
        made, what = Finished(session, stage), f"{stage}/{name}"
        return made.path(name) if name in made else None
    except ResultFileError as error:
        left_out[what] = f"{error.message} ({error.advice})"
        return None


def export(session: Path, into: Path, what: Sequence[str], *, label: bool = True, url: str = "") -> Exported:
    """Write a session's results into a folder.

    ``what``: some of `KINDS`. jpeg: in the one display of the room, with panorama tags; staged and emptied ones carry
      label, statement and IPTC's source type. hdr, exr: in cd/m2. gltf: the room, and each staged room.
    ``label``: whether staged and emptied pictures show what they are; their metadata always say so.
    ``url``: where the unaltered ones will be on the web; without it the one is named that lies beside.
    Raises `ParameterError`: an unknown kind, or a session that has not been processed.
    """
    unknown = set(what) - set(KINDS)
    if unknown or not what:
        what_else = ", ".join(sorted(unknown)) or "none is named"
        raise ParameterError(f"unknown kind of file: {what_else}", advice=f"choose from {', '.join(KINDS)}, glare")
    if not (session / "stages" / "calibrate").is_dir():
        raise ParameterError("has no results yet", where=str(session), advice="run daylit process on it first")
    into.mkdir(parents=True, exist_ok=True)
    done = Exported()
    if set(what) & {"jpeg", "hdr", "exr"}:
        _pictures(session, into, what, done, (label, url))
    if "gltf" in what:
        _models(session, into, done)
    return done


def _pictures(session: Path, into: Path, what: Sequence[str], to: Exported, how: tuple[bool, str]) -> None:
    recorded(session, "room", "room.json", to.left_out)  # where the windows are
    showing = session_shown(session) if "jpeg" in what else None
    every = pictures_of(session, to.left_out)
    heading_rad = load_manifest(session).heading_rad
    original = how[1] or (f"{session.name}_{ROOM}.jpg" if ROOM in every else "")
    for name, file in every.items():
        image = read_shown(file)
        assert isinstance(image, LuminanceImage)
        stem = into / f"{session.name}_{name}"
        for kind in what:
            try:
                if kind in ("hdr", "exr"):
                    path = stem.with_name(f"{stem.name}.{kind}")
                    (write_radiance_hdr if kind == "hdr" else write_exr)(path, image)
                    to.files.append(path)
                elif kind == "jpeg" and showing is not None:
                    made = made_of(session, name, original=original)
                    to.files.append(_jpeg(stem, image, made, (showing, heading_rad, how[0])))
            except (PictureFileError, ParameterError) as error:
                to.left_out[f"{name}.{kind}"] = str(error)


def _jpeg(stem: Path, image: LuminanceImage, made: Made, how: tuple[Shown, float | None, bool]) -> Path:
    (showing, heading_rad, label), name = how, stem.name.rpartition("_")[2]
    sky, tags = name == SKY, None
    shown = showing.display.exposed(image.rgb).shown(image.rgb) if sky else showing.rgb8(image.rgb, image.geometry)
    if isinstance(image.geometry, Equirectangular):
        azimuth = None if heading_rad is None else heading_rad + image.geometry.yaw_rad  # a sky's middle is north
        tags = PanoramaTags.whole(image.geometry.width_px, image.geometry.height_px, heading_rad=azimuth)
    path = stem.with_name(stem.name + ".jpg")
    shown = made.on(shown) if label else shown
    write_jpeg(path, shown, panorama=tags, made=made, relative=not image.absolute, title=name)
    return path


def write_original(session: Path, into: Path, showing: Shown) -> str:
    """Write the unaltered photograph beside pictures that were made of it; return its name, "" where there is none."""
    image, how = photograph_of(session), (showing, load_manifest(session).heading_rad, False)
    return "" if image is None else _jpeg(into / "original", image, Made(), how).name


def _models(session: Path, into: Path, done: Exported) -> None:
    scene = recorded(session, "materials", "scene.npz", done.left_out)
    if scene is not None:
        path = into / f"{session.name}_room.glb"
        try:
            made, eye_m = read_scene(scene), None
            if (file := recorded(session, "room", "room.json", done.left_out)) is not None:
                room = read_room(file)
                eye_m = (0.0, 0.0, room.camera_height_m)
                empty = recorded(session, "remove", "empty.exr", done.left_out)
                image = photograph_of(session) if empty is None else read_exr(empty)
                if isinstance(image, LuminanceImage) and isinstance(image.geometry, Equirectangular):
                    made = finely(made, image, room)
            write_scene_glb(path, made, eye_m)
            done.files.append(path)
        except ProcessingError as error:
            done.left_out["room.gltf"] = str(error)
    else:
        done.left_out["room.gltf"] = "the room's materials were not estimated, or were deleted (stage materials)"
    for number in range(1, MOST_STAGED + 1):
        if (model := recorded(session, "render", f"staged-{number}.glb", done.left_out)) is not None:
            path = into / f"{session.name}_staged-{number}.glb"
            write_bytes(path, model.read_bytes())
            done.files.append(path)
