"""What a result depends on, as plain JSON values, and the digest of it.

The ingredients are kept beside the result, so that a later run can say what changed, not only that something did.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from station.session import SessionManifest

ALWAYS = ("schema_version", "session_id", "created_utc", "bracket", "simulated")
"""Fields of the manifest that every stage sees."""
_BLANK = {"name": "session"}
"""Required fields that no result depends on."""
FOLDER = "folder"
RELIGHT = "relight"
"""What `daylit relight` wrote beside the stages: in a row's ``reads``, its summaries and pictures count."""
_NO_FIELDS = {FOLDER, RELIGHT}

Json = Any
Ingredients = dict[str, Json]


def canonical(value: Json) -> bytes:
    """Return JSON as bytes, one way only: sorted keys, no spaces, shortest exact numbers."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False).encode()


def digest(value: Json) -> str:
    """Return the SHA-256 of a JSON value, hexadecimal."""
    return hashlib.sha256(canonical(value)).hexdigest()


def visible_part(manifest: SessionManifest, reads: tuple[str, ...]) -> SessionManifest:
    """Return the manifest with only the named fields; the rest is as if it had not been recorded.

    Raises `ValueError` for a name that is no field.
    """
    fields = SessionManifest.model_fields
    unknown = set(reads) - set(fields) - _NO_FIELDS
    if unknown:
        raise ValueError(f"session.json has no {sorted(unknown)}")
    if FOLDER in reads:
        return manifest
    hidden = set(fields) - set(reads) - set(ALWAYS)
    blank = {name: _BLANK.get(name, fields[name].get_default(call_default_factory=True)) for name in hidden}
    return manifest.model_copy(update=blank)


def session_ingredients(part: SessionManifest, reads: tuple[str, ...]) -> Json:
    """Return what a stage sees of the session: frames by file name, the other fields as they are."""
    names = (set(ALWAYS) | set(reads)) - _NO_FIELDS
    data = part.model_dump(mode="json", include=names)
    if "frames" in data:
        data["frames"] = {frame.pop("file"): frame for frame in data["frames"]}
    return data


def changes(old: Mapping[str, Json], new: Mapping[str, Json]) -> list[tuple[str, Json, Json]]:
    """Return (path, old, new) of every leaf that differs, in order of path; what is absent is None."""
    before, after = dict(_leaves(old)), dict(_leaves(new))
    paths = sorted(set(before) | set(after))
    return [(path, before.get(path), after.get(path)) for path in paths if before.get(path) != after.get(path)]


def _leaves(value: Json, path: str = "") -> list[tuple[str, Json]]:
    """Return (path, value) of every leaf; empty objects and lists are leaves."""
    if isinstance(value, Mapping) and value:
        items = [(str(key), inner) for key, inner in value.items()]
    elif isinstance(value, list) and value:
        items = [(str(index), inner) for index, inner in enumerate(value)]
    else:
        return [(path, value)]
    return [leaf for key, inner in items for leaf in _leaves(inner, f"{path} {key}" if path else key)]
