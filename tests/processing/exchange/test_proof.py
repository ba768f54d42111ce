"""Proof of stills: what it says, and that any changed byte is found."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.commands.results import still_paths
from processing.errors import ParameterError, ResultFileError
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
from processing.ground.finished import digest as digest_of
from station.session.folder import file_sha256
from tests.processing.finished import finish, finish_all
from tests.station.session.sessions import complete_session

MUTATIONS = 10_000 if os.environ.get("DAYLIT_TORTURE") == "1" else 200
SHARES = {"furniture": 0.16, "tripod": 0.02}
REMOVED = {"filled_share": 0.27, "synthesised_share": 0.04, "lifted_median_pct": 8.7}


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
        stills.append({**names, "state": state, "statement": "Furniture is virtual.", "shows": [], "lens_mm": 20.0})
    (folder / "stills.json").write_text(json.dumps({"stills": stills}))
    (path / "stages" / "arrange").mkdir()
    (path / "stages" / "render").mkdir()
    bed = {"id": "bed", "category": "bed", "size_m": [1.6, 2, 0.8], "t_m": [1, 1, 0], "theta_rad": 0.0}
    (path / "stages" / "arrange" / "arrangement.json").write_text(json.dumps({"arrangements": [{"items": [bed]}]}))
    rendered = {"alternatives": [{"changed_share": 0.2, "error": 0.01, "method": "differential"}]}
    (path / "stages" / "render" / "staged.json").write_text(json.dumps(rendered))
    finish_all(path, detect={"shares": SHARES}, remove=REMOVED)
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
    finish(session, "stills")
    return session


def test_signed_pictures_carry_credentials_that_c2pas_reader_verifies(photographed: Path, tmp_path: Path) -> None:
    c2pa = pytest.importorskip("c2pa", reason="the extra c2pa is not installed")
    pack = tmp_path / "proof"
    write_proof(photographed, pack, self_made_signer(datetime.now(UTC)))
    body = json.loads((pack / NAME).read_bytes())
    assert body["signed_by"]["self_made"] is True
    assert "vouched for by no one" in body["signed_by"]["name"]
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
    assert any("credentials are not valid" in line for line in wrong), (
        "who writes proof.json anew needs the signer's key"
    )


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
    for name in ("bad.pem", "none.pem"):
        with pytest.raises(ParameterError, match="no certificate with a private key"):
            read_signer(tmp_path / name)
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
    shutil.rmtree(session / "stages" / "stills")
    with pytest.raises(ParameterError, match="no stills"):
        write_proof(session, tmp_path / "none")
    capsys.readouterr()
    assert daylit.main(["stills", str(tmp_path / "nowhere")]) == 4
    assert "no such folder" in capsys.readouterr().err


def test_shares_removed_and_light_lifted_are_said(session: Path, tmp_path: Path) -> None:
    path, _ = write_proof(session, tmp_path / "proof")
    changes = json.loads(path.read_bytes())["changes"]
    assert changes["removed"] == {"shares_of_directions": SHARES, "filled_share": 0.27, "synthesised_share": 0.04}
    assert changes["relit"]["emptied"] == {"median_brighter_pct": 8.7}


def test_pieces_that_the_rendering_added_are_said(session: Path, tmp_path: Path) -> None:
    file = session / "stages" / "render" / "staged.json"
    rug = {"id": "rug-s1", "category": "rug", "model": "", "size_m": [2, 1, 0.01], "theta_rad": 0.0, "t_m": [0, 0, 0]}
    file.write_text(json.dumps({"alternatives": [{"changed_share": 0.2, "added": [rug]}]}))
    finish(session, "render")
    path, _ = write_proof(session, tmp_path / "proof")
    added = json.loads(path.read_bytes())["changes"]["added"]["staged-1"]
    assert [one["category"] for one in added] == ["bed", "rug"]


def test_a_mask_of_the_users_is_said(session: Path, tmp_path: Path) -> None:
    finish(session, "detect", given=("target",))
    path, _ = write_proof(session, tmp_path / "proof")
    assert json.loads(path.read_bytes())["changes"]["removed"]["mask"] == "given by the user"


@pytest.mark.parametrize("stage", ["arrange", "render", "detect", "remove"])
def test_what_was_changed_and_is_not_known_any_more_is_not_proved(session: Path, tmp_path: Path, stage: str) -> None:
    shutil.rmtree(session / "stages" / stage)
    with pytest.raises(ResultFileError, match=f"stages/{stage}: result.json .*daylit process .*--force {stage}"):
        write_proof(session, tmp_path / "proof")
    assert not (tmp_path / "proof").exists()


def test_after_clean_the_proof_is_the_same(session: Path, tmp_path: Path) -> None:
    _, digest = write_proof(session, tmp_path / "proof")
    assert daylit.main(["clean", str(session)]) == 0
    assert not (session / "stages" / "remove").exists()
    assert write_proof(session, tmp_path / "again")[1] == digest


def test_an_arrangement_that_was_made_anew_since_the_stills_is_not_proved(session: Path, tmp_path: Path) -> None:
    shown = file_sha256(finish(session, "arrange", artifacts={"arrangement": "arrangement.json"}) / "arrangement.json")
    finish(session, "stills", ingredients={"reads": {"arrange/arrangement": shown}})
    assert write_proof(session, tmp_path / "same")[0].is_file()
    finish(session, "stills", ingredients={"reads": {"arrange/arrangement": "0" * 64}})
    with pytest.raises(ParameterError, match=r"arrangement.json has been rebuilt since the stills"):
        write_proof(session, tmp_path / "other")


def test_stills_of_an_alternative_that_was_made_anew_are_not_proved(session: Path, tmp_path: Path) -> None:
    (session / "stages" / "arrange" / "arrangement.json").write_text('{"arrangements": []}')
    finish(session, "arrange")
    with pytest.raises(ParameterError, match="staged-1"):
        write_proof(session, tmp_path / "proof")


def changed(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1] + b"?")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def exchanged(path: Path) -> None:
    path.write_bytes((path.parent / "still-2.jpg").read_bytes())


@pytest.mark.parametrize("harm", [changed, cut, exchanged, Path.unlink])
@pytest.mark.parametrize("name", ["still-1.jpg", "still-1-original.jpg"])
def test_stills_that_are_not_as_they_were_made_are_neither_proved_nor_copied(
    session: Path, tmp_path: Path, harm: Callable[[Path], None], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    harm(session / "stages" / "stills" / name)
    for words in (["proof", str(session)], ["stills", str(session)]):
        assert daylit.main([*words, "--into", str(tmp_path / "out")]) == 5
        said = capsys.readouterr().err
        assert "PRC-001" in said
        assert name in said
        assert f"daylit process {session}" in said
        assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["garbage", "[]", "null", "{}", '{"stills": []}'])
@pytest.mark.parametrize("file", ["stills/stills.json", "stills/result.json"])
def test_damaged_facts_of_stills_are_a_typed_error(
    session: Path, tmp_path: Path, text: str, file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (session / "stages" / file).write_text(text)
    for words in (["proof", str(session)], ["stills", str(session)]):
        assert daylit.main([*words, "--into", str(tmp_path / "out")]) == 5
        assert Path(file).name in capsys.readouterr().err


@pytest.mark.parametrize("text", ["garbage", "[]", "null", "{}"])
@pytest.mark.parametrize(
    "file", ["render/staged.json", "arrange/arrangement.json", "detect/result.json", "remove/result.json"]
)
def test_damaged_records_of_changes_are_a_typed_error(session: Path, tmp_path: Path, text: str, file: str) -> None:
    (session / "stages" / file).write_text(text)
    with pytest.raises(ResultFileError, match=Path(file).name):
        write_proof(session, tmp_path / "proof")


@pytest.mark.parametrize("key", ["file", "original"])
@pytest.mark.parametrize("forged", [False, True])
def test_names_that_lead_out_of_the_folder_are_refused(
    session: Path, tmp_path: Path, key: str, forged: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """Even where the result's own records, seal and all, were written anew to fit."""
    folder = session / "stages" / "stills"
    victim = "../../../victim.txt"
    (folder / victim).write_text("theirs")
    facts = json.loads((folder / "stills.json").read_text())
    facts["stills"][0][key] = victim
    (folder / "stills.json").write_text(json.dumps(facts))
    if forged:
        finish(session, "stills")
        result = json.loads((folder / "result.json").read_text())
        del result["seal"]
        result["files"][victim] = {"size_bytes": 6, "sha256": hashlib.sha256(b"theirs").hexdigest()}
        (folder / "result.json").write_text(json.dumps(result | {"seal": digest_of(result)}))
    deep = tmp_path / "a" / "b" / "c" / "d"
    deep.mkdir(parents=True)
    for words in (["proof", str(session)], ["stills", str(session)]):
        assert daylit.main([*words, "--into", str(deep)]) == 5
        assert "PRC-001" in capsys.readouterr().err
    assert list((tmp_path / "a").rglob("*.txt")) == []


@pytest.mark.parametrize("what", ["pictures", "frames"])
def test_a_pack_that_names_files_outside_is_changed_and_they_are_not_read(
    session: Path, tmp_path: Path, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pack = tmp_path / "proof"
    write_proof(session, pack)
    body = json.loads((pack / NAME).read_bytes())
    del body["sha256"]
    (tmp_path / "victim.txt").write_text("theirs")
    body[what][0] |= {"file": "../victim.txt", "sha256": hashlib.sha256(b"theirs").hexdigest()}
    body["chain"] = _chain([one["sha256"] for one in body["frames"]], [one["sha256"] for one in body["pictures"]])
    body["sha256"] = hashlib.sha256(_canonical(body)).hexdigest()
    (pack / NAME).write_bytes(_canonical(body))
    monkeypatch.setattr("processing.exchange.proof.file_sha256", lambda _path: pytest.fail("read"))
    assert check_proof(pack, session=session) == [f"{NAME}: changed"]


def test_a_run_lists_stills_that_are_whole_and_goes_on_without_damaged_ones(session: Path) -> None:
    assert [path.name for path in still_paths(session)] == ["still-1.jpg", "still-2.jpg"]
    cut(session / "stages" / "stills" / "still-2.jpg")
    assert still_paths(session) == []


def test_a_share_that_was_changed_by_hand_is_not_proved(session: Path, tmp_path: Path) -> None:
    path = session / "stages" / "detect" / "result.json"
    path.write_text(path.read_text().replace("0.16", "0.06"))
    with pytest.raises(ResultFileError, match=r"result.json has changed since it was written"):
        write_proof(session, tmp_path / "proof")
