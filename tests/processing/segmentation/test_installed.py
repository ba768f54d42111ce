"""Networks of others: fetched only from where one is asked to, kept only whole, and used only when installed."""

from __future__ import annotations

import gc
import hashlib
import http.server
import json
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.shared_data import DATA
from processing.commands.models import models
from processing.errors import ModelError
from processing.pipeline import stage_named
from processing.running.requests import RunRequest, given_files
from processing.segmentation import installed as module
from processing.segmentation.evidence import SceneClass
from processing.segmentation.installed import (
    ADE20K_DEEPLAB,
    KnownModel,
    add_model,
    get_model,
    installed,
    open_installed,
)

CONTENT = b"weights of a network" * 100
REAL = DATA / "weights" / ADE20K_DEEPLAB.file


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> KnownModel:
    """The list holds one small file, and nothing is installed."""
    digest = hashlib.sha256(CONTENT).hexdigest()
    model = ADE20K_DEEPLAB._replace(name="small", file="small.tflite", size_bytes=len(CONTENT), sha256=digest)
    monkeypatch.setattr(module, "KNOWN_MODELS", (model,))
    monkeypatch.setenv("DAYLIT_MODELS", str(tmp_path / "models"))
    return model


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """A server on this computer, with the file and another of its name."""
    (tmp_path / "served").mkdir()
    (tmp_path / "served" / "good").write_bytes(CONTENT)
    (tmp_path / "served" / "other").write_bytes(CONTENT[:-1])
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=str(tmp_path / "served"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as httpd:
        thread = threading.Thread(target=httpd.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{httpd.server_address[1]}"
        httpd.shutdown()
        thread.join(10)


def test_a_model_is_fetched_once_and_checked(known: KnownModel, server: str) -> None:
    assert installed(known) is None
    path = get_model(known, url=f"{server}/good")
    assert path.read_bytes() == CONTENT
    assert installed(known) == path
    assert [one.name for one in path.parent.iterdir()] == ["small.tflite"]
    assert get_model(known, url=f"{server}/gone") == path  # it is there: nothing is fetched


@pytest.mark.filterwarnings(
    "ignore::pytest.PytestUnraisableExceptionWarning"
)  # the client leaves a socket to the collector
@pytest.mark.parametrize("name", ["other", "gone"])
def test_another_file_and_none_leave_nothing_behind(known: KnownModel, server: str, name: str) -> None:
    with pytest.raises(ModelError, match="cannot be downloaded") as caught:
        get_model(known, url=f"{server}/{name}")
    assert "models add" in caught.value.advice
    assert list(module.models_folder().iterdir()) == []
    gc.collect(1)  # what was just made: to search all that a worker holds takes a second


def test_a_file_added_by_hand_is_known_by_its_digest(known: KnownModel, tmp_path: Path) -> None:
    mine = tmp_path / "download (1)"
    mine.write_bytes(CONTENT)
    assert add_model(mine) == (known, module.models_folder() / known.file)
    mine.write_bytes(CONTENT + b"x")
    with pytest.raises(ModelError, match="no known model"):
        add_model(mine)
    # A file that was damaged since is not used.
    (module.models_folder() / known.file).write_bytes(CONTENT[::-1])
    assert installed(known) is None


def test_the_command_lists_and_adds(known: KnownModel, tmp_path: Path) -> None:
    mine = tmp_path / "file"
    mine.write_bytes(CONTENT)
    run = CliRunner().invoke(models, ["add", str(mine)], standalone_mode=False)
    assert "small: " in run.output
    rows = json.loads(CliRunner().invoke(models, ["list", "--json"], standalone_mode=False).output)["models"]
    assert [(row["name"], row["size_bytes"], row["sha256"]) for row in rows] == [("small", 2000, known.sha256)]
    assert rows[0]["installed"].endswith("small.tflite")


def test_what_a_stage_depends_on_is_the_installed_file(
    known: KnownModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = stage_named("room")

    def _files(**options: object) -> dict[str, Path]:
        return given_files(room, RunRequest(options={f"--{name}": value for name, value in options.items()}))

    monkeypatch.setattr(module, "installed", lambda: None)
    assert _files() == _files(segmenter="own") == {}
    with pytest.raises(ModelError, match="no model is installed"):
        _files(segmenter="fuse")
    there = tmp_path / "network.tflite"
    there.touch()
    monkeypatch.setattr(module, "installed", lambda: there)
    assert _files() == _files(segmenter="fuse") == {"segmenter": there}
    assert _files(segmenter="own") == {}


@pytest.mark.shared(f"weights/{ADE20K_DEEPLAB.file}", "panoramas/furnished")
def test_the_pinned_network_gives_scores_and_knows_a_bed() -> None:
    from benchmarks.room.detect_truth import hand_mask, photograph
    from processing.ground.colour import srgb_of_linear

    assert (REAL.stat().st_size, hashlib.sha256(REAL.read_bytes()).hexdigest()) == ADE20K_DEEPLAB[3:5]
    network = open_installed(REAL)
    panorama = srgb_of_linear(photograph(DATA / "panoramas" / "furnished" / "bedroom_hn.png").rgb)
    drawn = hand_mask("bedroom_hn") == 255
    view = slice(None), slice(256, 768)
    found = network.probabilities(np.ascontiguousarray(panorama[view]))[..., SceneClass.FURNITURE]
    assert found.shape == (128, 128)
    assert np.unique(found).size > 1000  # probabilities, not class numbers
    inside = drawn[view][2::4, 2::4]
    assert found[inside].mean() > 0.7 > 0.25 > found[~inside].mean()
