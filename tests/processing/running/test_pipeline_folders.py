"""Folders as options of stages, and pictures that a stage writes itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import pytest

from processing.errors import ParameterError, PictureFileError, ProcessingError
from processing.pipeline import Artifact, Stage
from processing.running import requests
from processing.running.artifacts import WRITTEN, save
from processing.running.requests import RunRequest, given_files
from processing.stages.parameters import StageParameters, path_field


class WithFolder(StageParameters):
    models: Annotated[Path | None, path_field("folder", "A folder.")] = None


STAGE = Stage("toy", 1, "toy", "none:none", parameters=f"{__name__}:WithFolder")


@pytest.fixture
def models(tmp_path: Path) -> Path:
    folder = tmp_path / "models"
    (folder / "inner").mkdir(parents=True)
    (folder / "a.glb").write_bytes(b"one")
    (folder / "inner" / "b.obj").write_bytes(b"two")
    return folder


def test_a_folder_is_handed_on_and_one_that_is_none_is_refused(models: Path) -> None:
    assert given_files(STAGE, RunRequest(options={"--models": models})) == {"models": models}
    for wrong in (models / "a.glb", models / "none"):
        with pytest.raises(ParameterError, match="--models: there is no folder"):
            given_files(STAGE, RunRequest(options={"--models": wrong}))


def test_a_folder_counts_by_what_is_in_it(models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def digest() -> str:
        return requests.digests({"models": models})["models"]

    first = digest()
    assert digest() == first
    (models / "a.glb").write_bytes(b"six")
    changed = digest()
    assert changed != first
    monkeypatch.setattr(requests, "READ_FOLDER_BYTES", 1)
    by_size = digest()
    (models / "a.glb").write_bytes(b"ten")
    assert digest() == by_size
    (models / "a.glb").rename(models / "c.glb")
    assert digest() != by_size


def test_a_picture_that_the_stage_wrote_must_be_there(tmp_path: Path) -> None:
    picture = Artifact("staged", "picture")
    with pytest.raises(ProcessingError, match=r"has not written staged\.exr"):
        save(picture, WRITTEN, tmp_path)
    (tmp_path / "staged.exr").write_bytes(b"no picture")
    assert save(picture, WRITTEN, tmp_path) == tmp_path / "staged.exr"
    from processing.running.artifacts import load

    with pytest.raises(PictureFileError):
        load(picture, tmp_path / "staged.exr")
