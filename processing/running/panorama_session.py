"""A session of one panorama: the way in for those who have a photograph, and neither brackets nor a meter."""

import hashlib
from pathlib import Path
from uuid import uuid4

from drivers.clock import SystemClock
from drivers.errors import DaylitError
from processing.errors import PictureFileError
from processing.pictures.panorama import panorama_format, read_panorama
from station.session.folder import Folder, write_file
from station.session.session import PANORAMA_FOLDER, BracketRecord, PanoramaRecord, SessionManifest, Site, WarningRecord
from station.session.store import SessionStore, load_manifest

ENDINGS = {"jpeg": "jpg", "tiff": "tif"}  # where they are not the format's name
MAX_FILE_BYTES = 1 << 30


def panorama_session(path: Path, into: Path, *, site: Site | None = None) -> Path:
    """Return the session folder of a panorama's file: one in ``into`` made of the same bytes and facts, or a new one.

    Raises `PictureFileError` and `PanoramaError` for what cannot be taken; nothing is then made.
    """
    found = existing_session(path, into, site=site)
    if found is not None:
        return found
    data = _bytes(path)
    height, width = read_panorama(path).image.rgb.shape[:2]
    kind = panorama_format(path)
    record = PanoramaRecord(
        file=f"{PANORAMA_FOLDER}/panorama.{ENDINGS.get(kind, kind)}",
        format=kind,
        size_bytes=len(data),
        sha256=hashlib.sha256(data).hexdigest(),
        width_px=width,
        height_px=height,
        given_name=path.name[:200].encode("utf-8", "replace").decode(),
    )
    clock = SystemClock()
    manifest = SessionManifest(
        session_id=uuid4().hex,
        name=_name(path),
        created_utc=clock.utc_now(),
        site=site or Site(),
        bracket=BracketRecord(mode="panorama", stops_s=(), sides=()),
        readings_planned=0,
    )
    with SessionStore.create(into, manifest, clock=clock) as store:
        with Folder.open(store.path) as root:
            root.make_sub(PANORAMA_FOLDER)
            root.sync()
            with root.sub(PANORAMA_FOLDER) as folder:
                write_file(folder, record.file.partition("/")[2], data)
        store.update(panorama=record)
        store.add(WarningRecord(code="one_picture", message="one picture: no brackets, no meter, no sky"))
        store.finish()
        return store.path


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise PictureFileError(f"cannot be read: {error.strerror}", where=str(path)) from error
    if not data or len(data) > MAX_FILE_BYTES:
        what = "it is too large" if data else "it is empty"
        raise PictureFileError(what, where=str(path), advice="give a panorama's file")
    return data


def _name(path: Path) -> str:
    return path.stem[:100].encode("utf-8", "replace").decode() or "panorama"


def existing_session(path: Path, into: Path, *, site: Site | None = None) -> Path | None:
    """Return a session of the same bytes and facts, so that a second run does only what is new; None: there is none."""
    if not into.is_dir():
        return None
    digest = hashlib.sha256(_bytes(path)).hexdigest()
    for folder in sorted(into.iterdir()):
        try:
            manifest = load_manifest(folder)
        except DaylitError:
            continue
        same = manifest.panorama is not None and manifest.panorama.sha256 == digest and manifest.name == _name(path)
        if same and (manifest.site, manifest.heading_rad) == (site or Site(), None):
            return folder
    return None
