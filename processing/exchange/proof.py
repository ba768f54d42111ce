"""Proof of what was done to pictures: originals and results, what was changed, and digests chained to the frames.

``proof.json`` is canonical JSON that holds its own digest: a changed byte in it, in a picture or in a frame is found.
Who could have written the whole anew is not excluded: its digest is to be kept elsewhere, or the pictures carry signed
content credentials (C2PA) that are chained to the frames.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from processing.errors import ParameterError
from processing.exchange.credentials import Signer, credentials_of, signed_jpeg
from processing.pictures.writing import write_bytes
from station.session import strict_json
from station.session.folder import file_sha256
from station.session.store import load_manifest

NAME = "proof.json"
STATEMENT = (
    "Pictures of kind 'result' were altered by computer as listed under 'changes'; those of kind 'original' are the "
    "photograph in the same frame, altered in nothing but white balance, exposure and tone."
)


def write_proof(session: Path, into: Path, signer: Signer | None = None) -> tuple[Path, str]:
    """Write the pack of a processed session into a folder; return proof.json and its digest (hex SHA-256).

    ``signer``: puts content credentials into each picture, the original's into its result's. Raises `ParameterError`
    where the session has no stills.
    """
    folder = session / "stages" / "stills"
    if not (folder / "stills.json").is_file():
        raise ParameterError("there are no stills to prove", where=str(session), advice=f"daylit process {session}")
    stills = strict_json.loads((folder / "stills.json").read_bytes())["stills"]
    manifest = load_manifest(session)
    frames = [{"file": frame.file, "sha256": frame.sha256} for frame in manifest.frames]
    into.mkdir(parents=True, exist_ok=True)
    changes = _changes(session / "stages")
    pictures: list[dict[str, Any]] = []
    for one in stills:
        above: bytes | None = None
        for kind, name in (("original", one["original"]), ("result", one["file"])):
            data = (folder / name).read_bytes()
            facts = {"file": name, "kind": kind, "state": one["state"]}
            facts |= {"statement": one["statement"]} if kind == "result" else {}
            if signer is not None:
                facts["unsigned_sha256"] = hashlib.sha256(data).hexdigest()
                said = facts | {"session_id": manifest.session_id, "frames": frames}
                said |= {"chain": _chain([one["sha256"] for one in frames], [facts["unsigned_sha256"]])}
                said |= {"changes": _of_state(changes, one["state"])} if kind == "result" else {}
                above = data = signed_jpeg(data, signer, name, said, above)
            write_bytes(into / name, data)
            pictures.append(facts | {"sha256": hashlib.sha256(data).hexdigest()})
    body: dict[str, Any] = {
        "schema_version": 1,
        "made_with": f"daylit {version('daylit')}",
        "session_id": manifest.session_id,
        "name": manifest.name,
        "statement": STATEMENT,
        "frames": frames,
        "chain": _chain([one["sha256"] for one in frames], [one["sha256"] for one in pictures]),
        "pictures": pictures,
        "changes": changes,
        **({} if signer is None else {"signed_by": dict(signer.facts)}),
    }
    body["sha256"] = hashlib.sha256(_canonical(body)).hexdigest()
    write_bytes(into / NAME, _canonical(body))
    return into / NAME, file_sha256(into / NAME)


def check_proof(folder: Path, *, session: Path | None = None, digest: str | None = None) -> list[str]:
    """Return what is wrong with a pack: changed or missing bytes by file; nothing where all is as it was written.

    ``session``: its frames are read and compared, too. ``digest``: of proof.json, as it was kept elsewhere.
    """
    path = folder / NAME
    if not path.is_file():
        return [f"{NAME}: missing"]
    raw = path.read_bytes()
    try:
        body = strict_json.loads(raw)
        own = body.pop("sha256")
        intact = _canonical(body | {"sha256": own}) == raw and hashlib.sha256(_canonical(body)).hexdigest() == own
        pictures = [(str(one["file"]), str(one["sha256"])) for one in body["pictures"]]
        frames = [(str(one["file"]), str(one["sha256"])) for one in body["frames"]]
        chained = body["chain"] == _chain([sha for _, sha in frames], [sha for _, sha in pictures])
    except (strict_json.StrictJsonError, KeyError, TypeError, AttributeError, ValueError):
        return [f"{NAME}: changed"]
    found = [] if intact and digest in (None, hashlib.sha256(raw).hexdigest()) else [f"{NAME}: changed"]
    if not chained:
        found.append("chain: does not lead from these frames to these pictures")
    if body.get("signed_by"):
        for one in body["pictures"]:
            data = (folder / one["file"]).read_bytes() if (folder / one["file"]).is_file() else b""
            holds, said = credentials_of(data)
            if not holds or said.get("chain") != _chain([sha for _, sha in frames], [one.get("unsigned_sha256", "")]):
                found.append(f"{one['file']}: its content credentials do not hold")
    beside = [(folder, *one) for one in pictures] + ([] if session is None else [(session, *one) for one in frames])
    for place, name, sha in beside:
        if not (place / name).is_file():
            found.append(f"{name}: missing")
        elif file_sha256(place / name) != sha:
            found.append(f"{name}: changed")
    return found


def _chain(frames: list[str], pictures: list[str]) -> str:
    """Return the digest over the frames' digests in order, then the pictures'."""
    link = ""
    for sha in (*frames, *pictures):
        link = hashlib.sha256(f"{link}{sha}".encode()).hexdigest()
    return link


def _changes(stages: Path) -> dict[str, Any]:
    """Return what was added, what was removed, and by how much the room's light was changed."""
    arranged = _json(stages / "arrange" / "arrangement.json").get("arrangements", [])
    rendered = _json(stages / "render" / "staged.json").get("alternatives", [])
    detected = _json(stages / "detect" / "result.json").get("summary", {}).get("metrics", {})
    removed = _json(stages / "remove" / "result.json").get("summary", {}).get("metrics", {})
    added = {
        f"staged-{number}": [
            {name: item[name] for name in ("id", "category", "size_m", "t_m")} for item in one["items"]
        ]
        for number, one in enumerate(arranged[: len(rendered)], 1)
    }
    relit = {
        f"staged-{number}": {name: one[name] for name in ("changed_share", "error", "method") if name in one}
        for number, one in enumerate(rendered, 1)
    }
    if "lifted_median_pct" in removed:
        relit["emptied"] = {"median_brighter_pct": removed["lifted_median_pct"]}
    kept = {name: removed[name] for name in ("filled_share", "synthesised_share") if name in removed}
    return {"added": added, "removed": {"shares_of_directions": detected.get("shares", {}), **kept}, "relit": relit}


def _of_state(changes: Mapping[str, Any], state: str) -> dict[str, Any]:
    """Return the changes of one state: its own furniture and light, and what was removed for all."""
    kept = {name: changes[name][state] for name in ("added", "relit") if state in changes[name]}
    return kept | {"removed": changes["removed"]}


def _json(path: Path) -> Mapping[str, Any]:
    found = strict_json.loads(path.read_bytes()) if path.is_file() else {}
    return found if isinstance(found, dict) else {}


def _canonical(body: Mapping[str, Any]) -> bytes:
    return json.dumps(body, ensure_ascii=True, allow_nan=False, sort_keys=True, indent=1).encode() + b"\n"
