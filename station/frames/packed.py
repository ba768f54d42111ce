"""A session, or folders of frames, that come as one zip file: of anybody's, so that nothing in it is trusted."""

import os
import re
import shutil
import tempfile
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from station.errors import IntegrityError, SessionExistsError
from station.frames.importer import ImportRequest, import_session
from station.session import durable
from station.session.session import MANIFEST_NAME, Side
from station.session.store import load_manifest
from station.session.verify import JUNK

MOST_FILES, MOST_BYTES, MOST_DEEP = 10_000, 32 << 30, 8
"""Chosen: a day of full-size brackets with their results."""
MOST_RATIO, FREE_BYTES = 50, 1 << 26
"""By which more than so much is packed at most; chosen: frames hardly shrink, journals to a tenth, bombs to nothing."""
_NAME = re.compile(r"[^\x00-\x1f\\:]{1,200}")


def take_packed(archive: Path, into: Path) -> Path:
    """Return the session in ``into`` that a zip file holds or, of frames alone, is made of them as by `import_session`.

    Frames lie in folders called indoor and outdoor, or are all of the room. Raises `IntegrityError` for an archive that
    is damaged or would write elsewhere, `SessionExistsError`, and what reading a session or its frames raises; nothing
    is then made.
    """
    into.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".import-", dir=into) as place:
        root = Path(place) / archive.stem
        _unpack(archive, root)
        while not (root / MANIFEST_NAME).is_file() and len(only := list(root.iterdir())) == 1 and only[0].is_dir():
            root = only[0]
        if not (root / MANIFEST_NAME).is_file():
            sides = {side: root / side.value for side in Side if (root / side.value).is_dir()} or {Side.INDOOR: root}
            return import_session(ImportRequest(room=archive.stem[:80], folders=sides, into=into)).session
        load_manifest(root)
        if (session := into / root.name).exists():
            raise SessionExistsError("a session of this name already exists", where=session.name)
        return root.rename(session)


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
                strange = path.is_absolute() or ".." in path.parts or not all(map(_NAME.fullmatch, path.parts))
                if strange or link or len(path.parts) > MOST_DEEP or (target := into / path).exists():
                    raise IntegrityError(f"it holds {one.filename[:80]!r}", where=archive.name, likely="not a session")
                with durable.disk_errors(target, "unpacking"), packed.open(one) as source:
                    target.parent.mkdir(parents=True, exist_ok=True)
                    with target.open("xb") as file:
                        shutil.copyfileobj(source, file)
                        os.fsync(file.fileno())
        into.mkdir(exist_ok=True)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, FileExistsError) as error:
        raise IntegrityError(f"cannot be unpacked: {str(error)[:100]}", where=archive.name, likely="damaged") from error
