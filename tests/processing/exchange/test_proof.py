"""Proof of stills: what it says, and that any changed byte is found."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import daylit
from processing.errors import ParameterError
from processing.exchange.proof import NAME, check_proof, write_proof
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
