"""Proof of what was done to pictures: originals and results, what was changed, and digests chained to the frames.

``proof.json`` is canonical JSON that holds its own digest: a changed byte in it, in a picture or in a frame is found.
Who could have written the whole anew is not excluded: its digest is to be kept elsewhere, or the pictures carry signed
content credentials (C2PA) that are chained to the frames.
"""

import hashlib
import io
import json
import re
from collections.abc import Mapping
from datetime import datetime, timedelta
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from processing.errors import ParameterError
from processing.exchange.jpeg_files import DIGITAL_SOURCE, STAGED_SOURCE
from processing.ground.finished import PLAIN_NAME, Finished
from processing.pictures.writing import write_bytes
from station.session import strict_json
from station.session.folder import file_sha256
from station.session.store import load_manifest

# C2PA content credentials in JPEG files, signed and read by c2pa-python (C2PA specification 2); a self-made certificate
# shows that bytes are as they were written, and vouches for nobody: readers call it untrusted.

LABEL = "org.daylit.proof"  # of the assertion that chains a picture to its frames
SELF_MADE = "made by daylit for one proof - vouched for by no one"
"""Common name of a certificate that was made here: whoever reads it knows."""
SOURCES = {"original": f"{DIGITAL_SOURCE}computationalCapture", "result": STAGED_SOURCE}
"""IPTC's digital source types: several exposures joined by computer; a photograph with synthetic parts."""
ALGORITHMS = {"Ed25519PublicKey": "ed25519", "RSAPublicKey": "ps256", "secp256r1": "es256", "secp384r1": "es384"}
"""C2PA's words by kind of key, or curve."""
VALID_FOR = timedelta(days=3650)  # chosen: as long as a sale is disputed


class Signer(NamedTuple):
    """A certificate chain with its key, and what is said of it."""

    chain: bytes
    """PEM, the signer's own first."""
    key: bytes
    """PEM, PKCS 8, not encrypted."""
    algorithm: str
    """In C2PA's words."""
    facts: Mapping[str, str | bool]
    """Name, digest (SHA-256 of the certificate's DER), and whether it is self-made."""


def _c2pa() -> ModuleType:
    try:
        return import_module("c2pa")
    except ImportError as error:
        text = "content credentials need c2pa-python, which is not installed"
        raise ParameterError(text, where="--sign", advice="pip install 'daylit[c2pa]', or leave --sign out") from error


def self_made_signer(now: datetime) -> Signer:
    """Return a signer whose key is forgotten after use: an authority (C2PA asks for one) and a certificate of its."""
    _c2pa()
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.x509.oid import ExtendedKeyUsageOID

    keys, made = (Ed25519PrivateKey.generate(), Ed25519PrivateKey.generate()), []
    names = [x509.Name.from_rfc4514_string(f"CN={one},O=daylit") for one in (f"authority {SELF_MADE}", SELF_MADE)]
    for key, name, authority in zip(keys, names, (True, False), strict=True):
        own, above = key.public_key(), keys[0].public_key()
        usage = x509.KeyUsage(not authority, False, False, False, False, authority, authority, False, False)
        made.append(
            x509.CertificateBuilder(names[0], name, own, x509.random_serial_number())
            .not_valid_before(now - timedelta(days=1))
            .not_valid_after(now + VALID_FOR)
            .add_extension(x509.BasicConstraints(authority, 0 if authority else None), critical=True)
            .add_extension(usage, critical=True)
            .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.EMAIL_PROTECTION]), critical=False)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(own), critical=False)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(above), critical=False)
            .sign(keys[0], None)
        )
    return _signer(b"".join(one.public_bytes(form.Encoding.PEM) for one in reversed(made)), keys[1], self_made=True)


def read_signer(path: Path) -> Signer:
    """Return the signer of a PEM file: certificates, the signer's own first, and its private key, in any order.

    Raises `ParameterError` for a file that holds no such pair.
    """
    _c2pa()
    from cryptography import x509
    from cryptography.hazmat.primitives import serialization as form

    try:
        text = path.read_bytes()
        certificates = x509.load_pem_x509_certificates(text)
        start = text.index(b"-----BEGIN", max(0, text.index(b"PRIVATE KEY-----") - 40))
        key = form.load_pem_private_key(text[start:], password=None)
    except (OSError, ValueError, TypeError) as error:
        advice = "give one PEM file with the certificate, its chain, and the private key without a password"
        raise ParameterError(f"no certificate with a private key: {error}", where=str(path), advice=advice) from error
    return _signer(b"".join(one.public_bytes(form.Encoding.PEM) for one in certificates), key, self_made=False)


def _signer(chain: bytes, key: Any, *, self_made: bool) -> Signer:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives import serialization as form

    own = x509.load_pem_x509_certificates(chain)[0]
    public: Any = own.public_key()
    kind = public.curve.name if hasattr(public, "curve") else type(public).__name__
    if kind not in ALGORITHMS:
        raise ParameterError("C2PA does not support this type of key", where="--sign", advice="Ed25519, ECDSA or RSA")
    facts = {"name": own.subject.rfc4514_string(), "sha256": own.fingerprint(hashes.SHA256()).hex()}
    plain = key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    return Signer(chain, plain, ALGORITHMS[kind], facts | {"self_made": self_made})


def signed_jpeg(jpeg: bytes, signer: Signer, title: str, proof: Mapping[str, Any], original: bytes | None) -> bytes:
    """Return a JPEG with credentials; ``proof`` is said in its assertion ``org.daylit.proof``.

    ``original``: the JPEG with credentials that it was made from, None of a photograph. Raises `ParameterError` where
    c2pa refuses certificate or picture.
    """
    c2pa = _c2pa()
    kind = "original" if original is None else "result"
    steps: list[dict[str, Any]] = [{"action": "c2pa.created", "digitalSourceType": SOURCES[kind]}]
    if original is not None:
        made = {"action": "c2pa.edited", "digitalSourceType": SOURCES[kind], "description": str(proof["statement"])}
        steps = [{"action": "c2pa.opened", "parameters": {"ingredientIds": ["original"]}}, made]
    actions = {"label": "c2pa.actions.v2", "data": {"actions": steps}}
    said = {"title": title, "format": "image/jpeg", "assertions": [actions, {"label": LABEL, "data": dict(proof)}]}
    manifest = {"claim_generator_info": [{"name": "daylit"}], **said}
    out = io.BytesIO()
    try:
        with c2pa.Builder(manifest) as builder:
            if original is not None:
                above = {"title": f"original of {title}", "relationship": "parentOf", "label": "original"}
                builder.add_ingredient(above, "image/jpeg", io.BytesIO(original))
            info = c2pa.C2paSignerInfo(signer.algorithm.encode(), signer.chain, signer.key, None)
            builder.sign(c2pa.Signer.from_info(info), "image/jpeg", io.BytesIO(jpeg), out)
    except c2pa.C2paError as error:
        raise ParameterError(f"C2PA refuses to sign: {error}", where=title, advice="check the certificate") from error
    return out.getvalue()


def credentials_of(jpeg: bytes) -> tuple[bool, Mapping[str, Any]]:
    """Return whether C2PA's reader finds credentials that hold, and what their assertion says."""
    c2pa = _c2pa()
    try:
        with c2pa.Reader("image/jpeg", io.BytesIO(jpeg)) as reader:
            holds = reader.get_validation_state() in ("Valid", "Trusted")
            body = json.loads(reader.json())
            said = body["manifests"][body["active_manifest"]]["assertions"]
    except (c2pa.C2paError, KeyError, ValueError):
        return False, {}
    return holds, next((one["data"] for one in said if one["label"] == LABEL), {})


NAME, STILLS = "proof.json", Path("stages", "stills")
STATEMENT = (
    "Pictures of kind 'result' were altered digitally as listed under 'changes'; those of kind 'original' are the "
    "photograph in the same frame, altered only in white balance, exposure and tone."
)


def stills_of(session: Path) -> list[dict[str, Any]]:
    """Return the facts of a session's stills (docs/guides/report.md), the first the best; none where there are none.

    Raises `ResultFileError` where the facts, a still or its original are not as the stage wrote them, `SessionError`
    for no session.
    """
    if not (session / STILLS).is_dir():
        load_manifest(session)  # which says where there is no session
        return []
    made = Finished(session, STILLS.name)
    found = list(made.json("stills.json")["stills"]) if "stills.json" in made else []
    for name in [one[key] for one in found for key in ("file", "original")]:
        made.path(name)
    return found


def write_proof(session: Path, into: Path, signer: Signer | None = None) -> tuple[Path, str]:
    """Write the pack of a processed session into a folder; return proof.json and its digest (hex SHA-256).

    ``signer``: puts content credentials into each picture, the original's into its result's. Raises `ParameterError`
    where the session has no stills, `ResultFileError` where they, or what is known of the changes, are damaged or gone.
    """
    folder, stills = session / STILLS, stills_of(session)
    if not stills:
        raise ParameterError("no stills to prove", where=str(session), advice=f"daylit process {session}")
    manifest = load_manifest(session)
    frames = [{"file": frame.file, "sha256": frame.sha256} for frame in manifest.frames]
    changes = _changes(session, {one["state"] for one in stills})
    into.mkdir(parents=True, exist_ok=True)
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
                own = {key: changes[key][one["state"]] for key in ("added", "relit") if one["state"] in changes[key]}
                said |= {"changes": own | {"removed": changes["removed"]}} if kind == "result" else {}
                above = data = signed_jpeg(data, signer, name, said, above)
            write_bytes(into / name, data)
            pictures.append(facts | {"sha256": hashlib.sha256(data).hexdigest()})
    chain = _chain([one["sha256"] for one in frames], [one["sha256"] for one in pictures])
    body: dict[str, Any] = {"schema_version": 1, "made_with": f"daylit {version('daylit')}"}
    body |= {"session_id": manifest.session_id, "name": manifest.name, "statement": STATEMENT}
    body |= {"frames": frames, "chain": chain, "pictures": pictures, "changes": changes}
    body |= {} if signer is None else {"signed_by": dict(signer.facts)}
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
        pictures, frames = _listed(body["pictures"]), _listed(body["frames"])
        chained = body["chain"] == _chain([sha for _, sha in frames], [sha for _, sha in pictures])
    except (strict_json.StrictJsonError, KeyError, TypeError, AttributeError, ValueError):
        return [f"{NAME}: changed"]
    found = [] if intact and digest in (None, hashlib.sha256(raw).hexdigest()) else [f"{NAME}: changed"]
    if not chained:
        found.append("chain: it does not lead from these frames to these pictures")
    if body.get("signed_by"):
        for (name, _), one in zip(pictures, body["pictures"], strict=True):
            data = (folder / name).read_bytes() if (folder / name).is_file() else b""
            holds, said = credentials_of(data)
            if not holds or said.get("chain") != _chain([sha for _, sha in frames], [one.get("unsigned_sha256", "")]):
                found.append(f"{name}: its content credentials are not valid")
    beside = [(folder, *one) for one in pictures] + ([] if session is None else [(session, *one) for one in frames])
    for place, name, sha in beside:
        if not (place / name).is_file():
            found.append(f"{name}: missing")
        elif file_sha256(place / name) != sha:
            found.append(f"{name}: changed")
    return found


def _listed(entries: Any) -> list[tuple[str, str]]:
    """Return names and digests; `ValueError` for a name that leads out of its folder."""
    found = [(str(one["file"]), str(one["sha256"])) for one in entries]
    if not all(re.fullmatch(rf"(\w+/)?{PLAIN_NAME[1:]}", name) for name, _ in found):
        raise ValueError("no plain file name")
    return found


def _chain(frames: list[str], pictures: list[str]) -> str:
    """Return the digest over the frames' digests in order, then the pictures'."""
    link = ""
    for sha in (*frames, *pictures):
        link = hashlib.sha256(f"{link}{sha}".encode()).hexdigest()
    return link


def _changes(session: Path, states: set[str]) -> dict[str, Any]:
    """Return what was added, what was removed, and by how much the room's light was changed.

    Raises `ResultFileError` where a stage's record of it is gone: nothing is said to be unchanged that is not known."""
    arrange, render, detect, remove = (Finished(session, one) for one in ("arrange", "render", "detect", "remove"))
    added, relit = dict[str, Any](), dict[str, Any]()
    shown = Finished(session, STILLS.name).facts.get("ingredients", {}).get("reads", {})
    for name, made in (("arrange", arrange.facts), ("render", render.facts)):
        for key, file in made.get("artifacts", {}).items():
            if shown.get(f"{name}/{key}") not in (None, made["files"].get(file, {}).get("sha256")):
                raise ParameterError(f"{file} has been rebuilt since the stills", advice=f"daylit process {session}")
    if "arrangement.json" in arrange and "staged.json" in render:
        arranged = arrange.json("arrangement.json")["arrangements"]
        rendered = render.json("staged.json")["alternatives"]
        for number, (of, one) in enumerate(zip(arranged, rendered, strict=False), 1):
            pieces, keys = [*of["items"], *one.get("added", ())], ("id", "category", "size_m", "t_m")
            added[f"staged-{number}"] = [{key: piece[key] for key in keys} for piece in pieces]
            relit[f"staged-{number}"] = {key: one[key] for key in ("changed_share", "error", "method") if key in one}
    if unknown := sorted({one for one in states if one.startswith("staged")} - added.keys()):
        raise ParameterError(f"what was added to {unknown} has been rebuilt since", advice=f"daylit process {session}")
    metrics = remove.facts["metrics"]
    if "lifted_median_pct" in metrics:
        relit["emptied"] = {"median_brighter_pct": metrics["lifted_median_pct"]}
    removed = {key: metrics[key] for key in ("filled_share", "synthesised_share") if key in metrics}
    removed |= {"shares_of_directions": detect.facts["metrics"].get("shares", {}) if metrics else {}}
    removed |= {"mask": "given by the user"} if detect.facts["given"] else {}
    return {"added": added, "removed": removed, "relit": relit}


def _canonical(body: Mapping[str, Any]) -> bytes:
    return json.dumps(body, ensure_ascii=True, allow_nan=False, sort_keys=True, indent=1).encode() + b"\n"
