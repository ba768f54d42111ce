"""Proof of stills: what it says, and that any changed byte is found."""

from __future__ import annotations

import hashlib
import io
import json
import os
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.errors import ParameterError
from processing.exchange.proof import (
    LABEL,
    NAME,
    _canonical,
    _chain,
    check_proof,
    credentials_of,
    read_signer,
    self_made_signer,
    write_proof,
)
from tests.station.session.sessions import complete_session

MUTATIONS = 10_000 if os.environ.get("DAYLIT_TORTURE") == "1" else 200


@pytest.fixture
def session(tmp_path: Path) -> Path:
    """A complete session with two stills, staged and emptied, of a few bytes each."""
    path = complete_session(tmp_path / "sessions")
    folder = path / "stages" / "stills"
    folder.mkdir(parents=True)
    stills = []
    for number, state in enumerate(("staged-1", "emptied"), 1):
        for name in (f"still-{number}.jpg", f"still-{number}-original.jpg"):
            (folder / name).write_bytes(name.encode() * 40)
        names = {"file": f"still-{number}.jpg", "original": f"still-{number}-original.jpg"}
        stills.append({**names, "state": state, "statement": "Furniture is virtual."})
    (folder / "stills.json").write_text(json.dumps({"stills": stills}))
    (path / "stages" / "arrange").mkdir()
    (path / "stages" / "render").mkdir()
    bed = {"id": "bed", "category": "bed", "size_m": [1.6, 2, 0.8], "t_m": [1, 1, 0], "theta_rad": 0.0}
    (path / "stages" / "arrange" / "arrangement.json").write_text(json.dumps({"arrangements": [{"items": [bed]}]}))
    rendered = {"alternatives": [{"changed_share": 0.2, "error": 0.01, "method": "differential"}]}
    (path / "stages" / "render" / "staged.json").write_text(json.dumps(rendered))
    return path


def test_the_pack_says_what_was_changed_and_holds_originals(session: Path, tmp_path: Path) -> None:
    path, digest = write_proof(session, tmp_path / "proof")
    body = json.loads(path.read_bytes())
    assert {one["kind"] for one in body["pictures"]} == {"result", "original"}
    assert body["changes"]["added"]["staged-1"][0]["category"] == "bed"
    assert body["changes"]["relit"]["staged-1"]["changed_share"] == 0.2
    assert len(body["frames"]) >= 3
    assert check_proof(tmp_path / "proof", session=session, digest=digest) == []
    assert write_proof(session, tmp_path / "again")[1] == digest


@pytest.mark.sweep
def test_any_changed_byte_is_found(session: Path, tmp_path: Path) -> None:
    pack = tmp_path / "proof"
    _, digest = write_proof(session, pack)
    files = [*pack.iterdir(), *(session / one["file"] for one in json.loads((pack / NAME).read_bytes())["frames"])]
    rng = np.random.default_rng(23)
    for _ in range(MUTATIONS):
        path = files[int(rng.integers(len(files)))]
        before = path.read_bytes()
        data = bytearray(before)
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        found = check_proof(pack, session=session)
        path.write_bytes(before)
        assert any(path.name in line for line in found), path
    assert check_proof(pack, session=session, digest=digest) == []
    assert check_proof(pack, digest="0" * 64) == [f"{NAME}: changed"]


@pytest.fixture
def photographed(session: Path) -> Path:
    """The same session with pictures that are JPEG files."""
    rng = np.random.default_rng(5)
    for path in sorted((session / "stages" / "stills").glob("*.jpg")):
        Image.fromarray(rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)).save(path, quality=85)
    return session


def test_signed_pictures_carry_credentials_that_c2pas_reader_verifies(photographed: Path, tmp_path: Path) -> None:
    c2pa = pytest.importorskip("c2pa", reason="the extra c2pa is not installed")
    pack = tmp_path / "proof"
    write_proof(photographed, pack, self_made_signer(datetime.now(UTC)))
    body = json.loads((pack / NAME).read_bytes())
    assert body["signed_by"]["self_made"] is True
    assert "vouched for by nobody" in body["signed_by"]["name"]
    for one in body["pictures"]:
        with c2pa.Reader("image/jpeg", io.BytesIO((pack / one["file"]).read_bytes())) as reader:
            assert reader.get_validation_state() == "Valid"
            manifests = json.loads(reader.json())
        active = manifests["manifests"][manifests["active_manifest"]]
        (said,) = (a["data"] for a in active["assertions"] if a["label"] == LABEL)
        assert said["frames"] == body["frames"]
        if one["kind"] == "result":
            assert said["changes"]["removed"] == body["changes"]["removed"]
            assert [above["relationship"] for above in active["ingredients"]] == ["parentOf"]
            with Image.open(pack / one["file"]) as picture:
                assert picture.size == (96, 64)
    assert check_proof(pack, session=photographed) == []


@pytest.mark.sweep
def test_a_changed_byte_breaks_the_credentials_and_other_frames_the_chain(photographed: Path, tmp_path: Path) -> None:
    pytest.importorskip("c2pa", reason="the extra c2pa is not installed")
    pack = tmp_path / "proof"
    write_proof(photographed, pack, self_made_signer(datetime.now(UTC)))
    rng, path = np.random.default_rng(9), pack / "still-1.jpg"
    before, alone = path.read_bytes(), 0
    for _ in range(MUTATIONS // 10):
        data = bytearray(before)
        data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
        path.write_bytes(data)
        assert any(path.name in line for line in check_proof(pack))
        alone += not credentials_of(bytes(data))[0]
    # Without proof.json C2PA's reader alone finds all but padding between its boxes.
    assert alone >= 0.9 * (MUTATIONS // 10)
    path.write_bytes(before)
    body = json.loads((pack / NAME).read_bytes())
    del body["sha256"]
    body["frames"][0]["sha256"] = "0" * 64
    body["chain"] = _chain([one["sha256"] for one in body["frames"]], [one["sha256"] for one in body["pictures"]])
    body["sha256"] = hashlib.sha256(_canonical(body)).hexdigest()
    (pack / NAME).write_bytes(_canonical(body))
    wrong = check_proof(pack)
    assert any("credentials do not hold" in line for line in wrong), "who writes proof.json anew needs the signer's key"


def test_a_users_certificate_signs_and_what_is_none_is_refused(photographed: Path, tmp_path: Path) -> None:
    pytest.importorskip("c2pa", reason="the extra c2pa is not installed")
    made = self_made_signer(datetime.now(UTC))
    (tmp_path / "own.pem").write_bytes(made.chain + made.key)
    assert (
        daylit.main(["proof", str(photographed), "--into", str(tmp_path / "p"), "--sign", str(tmp_path / "own.pem")])
        == 0
    )
    body = json.loads((tmp_path / "p" / NAME).read_bytes())
    assert body["signed_by"] == {**made.facts, "self_made": False}
    (tmp_path / "bad.pem").write_bytes(made.chain)
    with pytest.raises(ParameterError, match="no certificate with its key"):
        read_signer(tmp_path / "bad.pem")
    assert daylit.main(["proof", str(photographed), "--check", "--sign", "self"]) == 2


def test_what_is_missing_is_named_and_the_command_has_its_exit_codes(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert daylit.main(["proof", str(session)]) == 0
    assert "sha256" in capsys.readouterr().out
    assert daylit.main(["proof", str(session), "--check"]) == 0
    (tmp_path / f"{session.name}-proof" / "still-1.jpg").unlink()
    assert daylit.main(["proof", str(session), "--check", "--json"]) == 1
    assert "still-1.jpg: missing" in capsys.readouterr().out
    assert check_proof(tmp_path) == [f"{NAME}: missing"]
    (session / "stages" / "stills" / "stills.json").unlink()
    with pytest.raises(ParameterError, match="no stills"):
        write_proof(session, tmp_path / "none")
