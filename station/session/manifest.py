"""Reading session.json with suspicion, and writing it."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from station.errors import IntegrityError, ManifestError, SchemaTooNewError, SessionNotFoundError, UsageError
from station.session import strict_json
from station.session.folder import Folder, open_session
from station.session.session import MANIFEST_NAME, SCHEMA_VERSION, SessionManifest, Site

# Chosen: far above what 99 stops of two cameras need.
MAX_MANIFEST_BYTES = 16 << 20
_REMAKE = "if the journal is intact, `daylit verify --repair` rebuilds it"


def manifest_of(data: Any, where: str) -> SessionManifest:
    """Return the manifest that JSON data describe; `ManifestError` or `SchemaTooNewError` name ``where``."""
    if not isinstance(data, dict):
        raise ManifestError("not a JSON object", where=where)
    version = data.get("schema_version", 1)
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise ManifestError(f"schema_version is {version!r:.40}", where=where)
    if version > SCHEMA_VERSION:
        text = f"of schema {version}; this version of daylit supports up to {SCHEMA_VERSION}"
        raise SchemaTooNewError(text, where=where, advice="update daylit")
    try:
        manifest = SessionManifest.model_validate(data)
    except ValidationError as exc:
        faults = strict_json.faults_of(exc)
        reasons = "; ".join(faults[:5]) + (f"; and {len(faults) - 5} more" if len(faults) > 5 else "")
        raise ManifestError(f"does not match the schema: {reasons}", where=where, advice=_REMAKE) from exc
    # Refuse what the types allow but no station writes: shared files, a frame in the other side's folder
    files = [f.file for f in manifest.frames] + [r.file for r in manifest.rejected if r.file]
    keys = [(f.side, f.stop, f.format) for f in manifest.frames]
    if len({name.casefold() for name in files}) != len(files):
        raise ManifestError("two records name one file", where=where)
    if len(set(keys)) != len(keys):
        raise ManifestError("two frames of one side, stop and format", where=where)
    for frame in manifest.frames:
        if not frame.file.startswith(f"{frame.side}/"):
            raise ManifestError(f"{frame.file} is not a valid frame of {frame.side}", where=where)
        if frame.stop >= len(manifest.bracket.stops_s):
            raise ManifestError(f"{frame.file}: the bracket has no stop {frame.stop}", where=where)
    return manifest


def parse_manifest(raw: bytes, where: str) -> SessionManifest:
    """Return the manifest in the bytes of a session.json."""
    if len(raw) > MAX_MANIFEST_BYTES:
        raise ManifestError(f"larger than {MAX_MANIFEST_BYTES} bytes", where=where)
    try:
        data = strict_json.loads(raw)
    except strict_json.StrictJsonError as exc:
        raise ManifestError(str(exc), where=where, advice=_REMAKE) from exc
    return manifest_of(data, where)


def read_manifest(folder: Folder, name: str = MANIFEST_NAME) -> SessionManifest | None:
    """Return the manifest in an open session folder; None if there is none."""
    where = str(folder.path / name)
    try:
        raw = folder.read_file(name, MAX_MANIFEST_BYTES)
    except IntegrityError as exc:
        raise ManifestError(exc.message, where=where) from exc
    return None if raw is None else parse_manifest(raw, where)


def load_manifest(path: Path) -> SessionManifest:
    """Return the manifest of a session; ``path`` is its folder or its session.json.

    Raises `SessionNotFoundError`, `ManifestError` (file and reason) or `SchemaTooNewError`; bounded in time
    and memory whatever the file holds.
    """
    path = Path(path)
    if not path.exists():
        raise SessionNotFoundError("no such folder", where=str(path), advice="name a session folder")
    folder_path, name = (path, MANIFEST_NAME) if path.is_dir() else (path.parent, path.name)
    with open_session(folder_path) as folder:
        manifest = read_manifest(folder, name)
    if manifest is None:
        advice = "name a session folder (one that holds session.json)"
        raise SessionNotFoundError(f"no {name} here", where=str(folder_path), advice=advice)
    return manifest


def require_names(*names: str, where: str) -> None:
    """Refuse, with `UsageError`, a room's name (the first) or address: empty, too long, or not in UTF-8."""
    try:
        for name in names:
            Site(name=name)
        if not names[0].strip():
            raise ValueError
    except ValueError as error:
        text = "the room's name is empty, or it or its address is too long, or not in UTF-8"
        raise UsageError(text, where=where, advice="use at most 500 characters, in UTF-8") from error


def manifest_bytes(manifest: SessionManifest) -> bytes:
    """Return session.json's content."""
    return manifest.model_dump_json(indent=2).encode() + b"\n"
