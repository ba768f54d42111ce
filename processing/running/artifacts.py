"""What stages hand on: in memory within a run, from disk between runs, and no longer than somebody needs it.

Either way a stage sees the same: pictures are float32 in an EXR without loss, masks are bits in a PNG, JSON is handed
on as it reads back.
"""

from __future__ import annotations

import copy
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from processing.errors import ProcessingError
from processing.pipeline import Artifact, Stage, resolve
from station.session import strict_json

MAX_JSON_BYTES = 64 << 20
WRITTEN = True
"""Instead of an artifact's value: the stage has written the file."""
_SUFFIX = {"picture": ".exr", "mask": ".png", "json": ".json"}
_READ_PICTURE = "processing.pictures.exr:read_exr"
_WRITE_PICTURE = "processing.pictures.exr:write_exr"
_READ_MASK = "processing.pictures.masks:read_mask"
_WRITE_MASK = "processing.pictures.masks:write_mask"


def file_name(artifact: Artifact) -> str:
    """Return the name of an artifact's file in the stage's folder."""
    return artifact.file_name or artifact.name + _SUFFIX[artifact.kind]


def save(artifact: Artifact, value: object, folder: Path) -> object:
    """Write an artifact into ``folder`` and return what later stages are handed.

    A picture may be `WRITTEN` by the stage itself, so that large ones need not be in memory together. Raises
    `ProcessingError` for a "file" that the stage has not written, and what the writers raise.
    """
    path = folder / file_name(artifact)
    if artifact.kind == "picture" and value is not WRITTEN:
        resolve(_WRITE_PICTURE)(path, value)
        return value
    if artifact.kind == "mask":
        resolve(_WRITE_MASK)(path, value)
        return value
    if artifact.kind == "json":
        data = (json.dumps(value, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode("utf-8")
        path.write_bytes(data)
        return strict_json.loads(data)
    if not path.is_file():
        raise ProcessingError(f"the stage has not written {path.name}", where=folder.name)
    return path


def load(artifact: Artifact, path: Path) -> object:
    """Read an artifact; raises `PictureFileError` or `ProcessingError` naming the file."""
    if artifact.kind == "picture":
        return resolve(_READ_PICTURE)(path)
    if artifact.kind == "mask":
        return resolve(_READ_MASK)(path)
    if artifact.kind == "json":
        return read_json(path)
    return path


def read_json(path: Path) -> Any:
    """Return the JSON value in a file of at most `MAX_JSON_BYTES`; `ProcessingError` says what is wrong with it."""
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_JSON_BYTES + 1)
        if len(raw) > MAX_JSON_BYTES:
            raise strict_json.StrictJsonError(f"larger than {MAX_JSON_BYTES} bytes")
        return strict_json.loads(raw)
    except OSError as exc:
        raise ProcessingError(f"cannot be read: {exc.strerror}", where=str(path)) from exc
    except strict_json.StrictJsonError as exc:
        raise ProcessingError(str(exc), where=str(path), advice="correct the file") from exc


def _read_only(value: object) -> object:
    """Return a picture or mask whose arrays refuse writing: what one stage was handed, the next one gets unchanged."""
    for part in vars(value).values() if dataclasses.is_dataclass(value) else (value,):
        set_flags = getattr(part, "setflags", None)
        if set_flags:
            set_flags(write=False)
    return value


class Shelf:
    """Artifacts in memory, by stage and name; what is not there is read from disk once and kept."""

    def __init__(self, read: Callable[[str, str], object | None]) -> None:
        """``read(stage, artifact)``: from disk; None where the stage left it out."""
        self._read = read
        self._held: dict[tuple[str, str], object] = {}

    def put(self, stage: str, name: str, value: object) -> None:
        """Hand on what was just made."""
        self._held[stage, name] = _read_only(value)

    def get(self, stage: str, name: str) -> object | None:
        """Return an artifact; None where the stage left it out."""
        key = (stage, name)
        if key not in self._held:
            value = self._read(stage, name)
            if value is None:
                return None
            self._held[key] = _read_only(value)
        held = self._held[key]
        return copy.deepcopy(held) if isinstance(held, dict | list) else held

    def drop_unneeded(self, later: tuple[Stage, ...]) -> None:
        """Let go of what none of the ``later`` stages needs."""
        needed = {name for stage in later for name in stage.needs}
        self._held = {key: value for key, value in self._held.items() if key[0] in needed}

    @property
    def held(self) -> tuple[str, ...]:
        """Names of what is in memory, as stage/artifact."""
        return tuple(sorted("/".join(key) for key in self._held))
