"""A session, or folders of frames, that come as one zip file: of anybody's, so that nothing in it is trusted."""

import os
import re
import shutil
import tempfile
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path, PurePosixPath

from station.errors import IntegrityError, SessionExistsError, UsageError
from station.frames.importer import ImportReport, ImportRequest, import_session
from station.session import durable
from station.session.folder import make_folders
from station.session.session import MANIFEST_NAME, Side
from station.session.store import load_manifest
from station.session.verify import JUNK

MOST_FILES, MOST_BYTES, MOST_DEEP = 10_000, 32 << 30, 8  # chosen: a day of full-size brackets with their results
MOST_RATIO, FREE_BYTES = 50, 1 << 26
"""By which more than so much is packed at most; chosen: frames hardly shrink, journals to a tenth, bombs to nothing."""
_NAME = re.compile(r"[^\x00-\x1f\\:]{1,200}")


def take_packed(archive: Path, request: ImportRequest) -> tuple[Path, ImportReport | None]:
    """Return the session that a zip file holds or, of frames alone, is made as ``request`` says, then with its report.

    Frames lie in folders called indoor and outdoor, or are all of the room; ``request`` names none. Raises
    `IntegrityError` for an archive that is damaged or would write elsewhere, `SessionExistsError`, `UsageError` for a
    session of which ``request`` says more, and what reading a session or its frames raises; nothing is then made.
    """
    if request.folders:
        raise UsageError("a zip file and folders", where=archive.name, advice="give either")
    make_folders(into := request.into)
    with durable.disk_errors(into, "unpacking"), tempfile.TemporaryDirectory(prefix=".import-", dir=into) as place:
        root = Path(place) / archive.stem
        _unpack(archive, root)
        while not ((root / MANIFEST_NAME).is_file() or _sides(root)):
            if len(only := list(root.iterdir())) != 1 or not only[0].is_dir():
                break
            root = only[0]
        if not (root / MANIFEST_NAME).is_file():
            report = import_session(replace(request, folders=_sides(root) or {Side.INDOOR: root}))
            return report.session, report
        if request != ImportRequest(request.room, {}, into):
            raise UsageError("it holds a session, not frames", where=archive.name, advice="leave out all but --into")
        load_manifest(root)
        if (session := into / root.name).exists():
            raise SessionExistsError("a session of this name already exists", where=session.name)
        return root.rename(session), None


def _sides(root: Path) -> dict[Side, Path]:
    folders = (one for one in sorted(root.iterdir()) if one.is_dir() and one.name.lower() in tuple(Side))
    return {Side(one.name.lower()): one for one in folders}


def _unpack(archive: Path, into: Path) -> None:
    try:
        with zipfile.ZipFile(archive) as packed:
            files = [one for one in packed.infolist() if not one.is_dir() and not JUNK.search(one.filename)]
            most = min(MOST_BYTES, max(FREE_BYTES, MOST_RATIO * archive.stat().st_size))
            if len(files) > MOST_FILES or sum(one.file_size for one in files) > most:
                raise IntegrityError(f"more than {MOST_FILES} files, or {most >> 20} MiB", where=archive.name)
            for one in files:
                path = PurePosixPath(one.filename)
                link = one.external_attr >> 28 not in (0, 8)  # the file's kind, where it was packed on Unix
                strange = one.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or path.is_absolute()
                strange |= ".." in path.parts or not all(map(_NAME.fullmatch, path.parts))
                if strange or link or len(path.parts) > MOST_DEEP or (target := into / path).exists():
                    raise IntegrityError(
                        f"it holds {one.filename[:80]!r}", where=archive.name, likely="not by deflate, or no session"
                    )
                with durable.disk_errors(target, "unpacking"), packed.open(one) as source:
                    target.parent.mkdir(parents=True, exist_ok=True)
                    with target.open("xb") as file:
                        shutil.copyfileobj(source, file)
                        os.fsync(file.fileno())
        into.mkdir(exist_ok=True)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError) as error:
        what, likely = f"cannot be unpacked: {str(error)[:100]}", "damaged, or not there"
        raise IntegrityError(what, where=archive.name, likely=likely) from error
