"""`daylit process --panorama`: a session of one picture, merge left out, everything in relative units."""

from __future__ import annotations

import json
import os
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import daylit
from processing.errors import PanoramaError, PictureFileError
from processing.pictures.exr import read_exr
from processing.pictures.images import LuminanceImage
from processing.running.panorama_session import panorama_session
from processing.running.requests import RunRequest
from processing.running.results import Action
from processing.running.runner import process
from station.errors import IntegrityError
from station.session.session import SessionStatus, Site
from station.session.store import load_manifest
from station.session.verify import verify_session


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    rgb = np.random.default_rng(1).integers(60, 200, (64, 128, 3), dtype=np.uint8)
    rgb[20:30, 40:50] = 255
    Image.fromarray(rgb).save(tmp_path / "bedroom.png")
    return tmp_path / "bedroom.png"


def test_a_session_is_made_once_and_is_whole(photo: Path, tmp_path: Path) -> None:
    into = tmp_path / "sessions"
    path = panorama_session(photo, into)
    manifest = load_manifest(path)
    assert manifest.status is SessionStatus.COMPLETE
    assert manifest.panorama is not None
    assert (manifest.panorama.width_px, manifest.panorama.given_name) == (128, "bedroom.png")
    assert (path / manifest.panorama.file).read_bytes() == photo.read_bytes()
    assert verify_session(path).intact
    assert panorama_session(photo, into) == path
    assert panorama_session(photo, into, site=Site(latitude_deg=40.0, longitude_deg=-80.0)) != path
    photo.write_bytes(photo.read_bytes() + b"\0")
    assert panorama_session(photo, into) != path


def test_a_changed_or_missing_panorama_is_reported(photo: Path, tmp_path: Path) -> None:
    path = panorama_session(photo, tmp_path / "sessions")
    file = path / "given" / "panorama.png"
    data = bytearray(file.read_bytes())
    data[100] ^= 1
    file.chmod(0o644)
    file.write_bytes(bytes(data))
    assert [p.code for p in verify_session(path).problems] == ["digest"]
    file.unlink()
    assert [p.code for p in verify_session(path).problems] == ["missing"]


def test_a_panorama_that_changes_on_disk_ends_the_next_run_too(photo: Path, tmp_path: Path) -> None:
    """Not only the first: the results of before are no longer those of what lies there."""
    path, request = panorama_session(photo, tmp_path / "sessions"), RunRequest(until="calibrate")
    process(path, request)
    file = path / "given" / "panorama.png"
    file.chmod(0o644)
    data = bytearray(file.read_bytes())
    data[100] ^= 1
    file.write_bytes(bytes(data))
    with pytest.raises(IntegrityError, match="SHA-256"):
        process(path, request)


def test_nothing_is_made_of_what_is_refused(tmp_path: Path) -> None:
    Image.fromarray(np.zeros((100, 130, 3), np.uint8)).save(tmp_path / "photo.png")
    with pytest.raises(PanoramaError):
        panorama_session(tmp_path / "photo.png", tmp_path / "sessions")
    assert not (tmp_path / "sessions").exists()


def test_an_empty_file_is_called_empty(tmp_path: Path) -> None:
    (tmp_path / "none.jpg").touch()
    with pytest.raises(PictureFileError, match="is empty"):
        panorama_session(tmp_path / "none.jpg", tmp_path / "sessions")


@pytest.mark.parametrize("name", ["my room.png", "room.JPG", "room.exr", "room.hdr", "room.tif", "room.bmp"])
def test_a_picture_in_the_place_of_a_session_is_told_from_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    (tmp_path / name).write_bytes(b"\x89PNG")
    for more in ((), ("--dry-run",)):
        assert daylit.main(["process", str(tmp_path / name), *more, "--json"]) == 2
        error = json.loads(capsys.readouterr().out)["error"]
        assert "is a picture" in error["message"]
        assert shlex.split(error["advice"]) == ["daylit", "process", "--panorama", str(tmp_path / name)]


def test_merge_has_nothing_to_do_and_calibrate_is_relative(photo: Path, tmp_path: Path) -> None:
    path = panorama_session(photo, tmp_path / "sessions")
    done = {stage.stage: stage for stage in process(path, RunRequest(until="calibrate")).stages}
    assert done["merge"].action is Action.NOTHING_TO_DO
    assert done["merge"].reason == "a single picture, no bracket"
    result = done["calibrate"].summary
    assert set(result["left_out"]) == {"outdoor", "scale"}
    assert any("relative units" in one["message"] for one in result["warnings"])
    assert any("clipped" in one["message"] for one in result["warnings"])
    picture = read_exr(path / "stages" / "calibrate" / "indoor.exr")
    assert isinstance(picture, LuminanceImage)
    assert not picture.absolute
    facts = json.loads((path / "stages" / "calibrate" / "calibration.json").read_text("utf-8"))["indoor"]
    assert (facts["absolute"], facts["units"], facts["k1"]) == (False, "relative units", None)
    assert facts["illuminance_lx"] == {}


def test_k1_gives_it_a_scale(photo: Path, tmp_path: Path) -> None:
    path = panorama_session(photo, tmp_path / "sessions")
    process(path, RunRequest(until="calibrate", options={"--k1": 300.0}))
    picture = read_exr(path / "stages" / "calibrate" / "indoor.exr")
    assert isinstance(picture, LuminanceImage)
    assert picture.absolute
    assert float(picture.rgb.max()) == pytest.approx(300.0)
    facts = json.loads((path / "stages" / "calibrate" / "calibration.json").read_text("utf-8"))["indoor"]
    assert facts["k1"] == 300.0
    assert facts["illuminance_lx"]["up"]["value"] > 0


def test_the_command_takes_a_session_or_a_panorama(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    into = str(tmp_path / "sessions")
    assert daylit.main(["process"]) == 2
    assert daylit.main(["process", "x", "--panorama", str(photo)]) == 2
    assert daylit.main(["process", "x", "--into", into]) == 2
    assert daylit.main(["process", "--panorama", str(tmp_path / "none.jpg"), "--into", into]) == 2
    assert "none.jpg' does not exist" in capsys.readouterr().err
    arguments = ["process", "--panorama", str(photo), "--into", into, "--until", "calibrate"]
    assert daylit.main(arguments) == 0
    assert "nothing to do" in capsys.readouterr().out
    assert daylit.main(arguments) == 0
    assert "nothing to do" in capsys.readouterr().out


def test_a_dry_run_makes_no_session_and_finds_the_one_there_is(
    photo: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    into = tmp_path / "sessions"
    arguments = ["process", "--panorama", str(photo), "--into", str(into), "--dry-run"]
    assert daylit.main(arguments) == 0
    assert "would create a session from bedroom.png" in capsys.readouterr().out
    assert daylit.main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["units"] == "relative units"
    assert not into.exists()
    panorama_session(photo, into)
    assert daylit.main(arguments) == 0
    result = capsys.readouterr().out
    assert "would run" in result
    assert "on the new results of" in result
    assert " others" in result
    assert result.splitlines()[-1] == "--dry-run: nothing was run"


def test_a_name_that_is_no_utf8_is_shown_with_question_marks(photo: Path, tmp_path: Path) -> None:
    odd = photo.rename(tmp_path / os.fsdecode(b"caf\xe9.png"))
    made = panorama_session(odd, tmp_path / "sessions")
    manifest = load_manifest(made)
    assert manifest.panorama is not None
    assert (manifest.name, manifest.panorama.given_name) == ("caf?", "caf?.png")
    assert panorama_session(odd, tmp_path / "sessions") == made
