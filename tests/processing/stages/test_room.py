"""The stage room on a painted room: what it makes, leaves out and refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from processing.errors import RoomError
from processing.ground.room_model import OpeningKind, check_room, write_room
from processing.ground.seam import resized
from processing.light.scene.albedo import brought_to
from processing.pictures.images import LuminanceImage
from processing.room.estimate import estimate_room
from processing.segmentation.evidence import SceneClass, read_evidence
from processing.sphere import Equirectangular
from processing.stages.contract import Quality, StageContext
from processing.stages.parameters import RoomParameters
from processing.stages.room import run
from tests.processing.room.drawn_rooms import Patch, as_image, draw
from tests.processing.room.evidence import BOX, evidence_of, painted, picture_of, room_of, turned
from tests.station.session.sessions import manifest

NETWORKS = Path(__file__).parents[1] / "room" / "networks"


def calibrated(image) -> LuminanceImage:
    return LuminanceImage(image.rgb, image.uncertainty, image.validity, image.geometry, 0.02)


def context(image, folder: Path, quality: Quality = Quality.DRAFT, **asked) -> StageContext:
    made = {("calibrate", "indoor"): image}
    return StageContext(
        session=manifest(),
        session_path=folder,
        folder=folder,
        parameters=RoomParameters(**asked),
        fetch=lambda stage, name: made.get((stage, name)),
        summary=lambda _: {},
        quality=quality,
    )


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch):
    """Evidence of the box instead of the network's."""
    monkeypatch.setattr("processing.stages.room.scene_evidence", lambda *_, **__: evidence_of(room_of(BOX)))


@pytest.mark.usefixtures("by_hand")
def test_room_and_evidence_are_made_and_an_upright_picture_is_left_as_it_is(tmp_path: Path) -> None:
    output = run(context(calibrated(painted(room_of(BOX), 256)), tmp_path))
    check_room(output.artifacts["room"].model_dump(mode="json"))
    assert output.artifacts["room"].source == "estimated"
    assert output.artifacts["room"].camera_height_m == 1.6
    assert len(output.artifacts["room"].floor) == 4
    assert read_evidence(tmp_path / "evidence.npz").boundary is not None
    assert "is used unchanged" in output.left_out["panorama"]
    assert output.metrics["walls"] == 4
    assert len(output.metrics["wall_confidences"]) == 4


class ByBrightness:
    """A second network: all is wall, and what is bright a window, if it ``sees`` any."""

    name, size_px, fixed_size = "by brightness", 64, False

    def __init__(self, *, sees: bool) -> None:
        self.sees = sees

    def probabilities(self, view_rgb8):
        window = (view_rgb8.min(axis=2) > 200) & self.sees
        found = np.zeros((*window.shape, len(SceneClass)), np.float32)
        found[..., SceneClass.WALL], found[..., SceneClass.WINDOW] = ~window, window
        return found


@pytest.mark.parametrize(
    ("own", "sees", "alone", "fused"),
    [(0.65, False, 1, 0), (0.3, True, 0, 1)],
    ids=["veto", "confirm"],
)
def test_a_second_network_vetoes_and_confirms_windows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, own: float, sees: bool, alone: int, fused: int
) -> None:
    """Where a model is installed the stage takes the mean of both, for what is kept and for windows."""
    drawn = draw(256, patches=(Patch("front", -0.9, 0.4, 0.9, 2.1, 20.0, 0.2),))
    room = room_of(((-2.0, -1.5), (1.6, -1.5), (1.6, 2.4), (-2.0, 2.4)), ceiling=2.6)
    ours, pane = evidence_of(room), resized((drawn.patch > 0).astype(np.float32), (128, 256)) > 0.5
    ours.probabilities[:, pane] = 0.01
    ours.probabilities[SceneClass.WINDOW, pane], ours.probabilities[SceneClass.WALL, pane] = own, 0.94 - own
    monkeypatch.setattr("processing.stages.room.scene_evidence", lambda *_, **__: ours)
    monkeypatch.setattr("processing.stages.room.open_installed", lambda _: ByBrightness(sees=sees))
    picture = calibrated(as_image(drawn.luminance))
    for file, networks, windows in ((None, 1, alone), (Path("installed"), 2, fused)):
        monkeypatch.setattr("processing.stages.room.segmenter_file", lambda _, file=file: file)
        made = run(context(picture, tmp_path))
        assert read_evidence(tmp_path / "evidence.npz").networks == networks
        assert [one.kind for one in made.artifacts["room"].openings] == [OpeningKind.WINDOW] * windows


@pytest.mark.usefixtures("by_hand")
def test_the_camera_height_given_sets_the_scale(tmp_path: Path) -> None:
    output = run(context(calibrated(painted(room_of(BOX), 256)), tmp_path, camera_height_m=3.2, level="off"))
    assert output.artifacts["room"].camera_height_m == 3.2
    assert output.artifacts["room"].ceiling_height_m == pytest.approx(5.1, rel=0.02)
    assert "off" in output.left_out["panorama"]


@pytest.mark.usefixtures("by_hand")
def test_a_panorama_that_has_lost_a_row_is_made_whole_for_what_follows(tmp_path: Path) -> None:
    """Calibration takes it; light, materials and render would refuse it at the end of a long run."""
    image = calibrated(painted(room_of(BOX), 256))
    parts = {name: getattr(image, name)[:-1] for name in ("rgb", "uncertainty", "validity")}
    cut = replace(image, **parts, geometry=Equirectangular(256, 127))
    output = run(context(cut, tmp_path, level="off"))
    assert brought_to(output.artifacts["panorama"], 64, None)[0].shape == (64, 128, 3)
    assert "panorama" not in output.left_out


@pytest.mark.usefixtures("by_hand")
def test_a_room_that_is_not_levelled_still_knows_its_walls_azimuth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = []

    def estimate(*given, **named):
        result.append(named["manhattan_rad"])
        return estimate_room(*given, **named)

    monkeypatch.setattr("processing.stages.room.estimate_room", estimate)
    image = calibrated(painted(room_of(turned(BOX, 0.2)), 512))
    monkeypatch.setattr(
        "processing.stages.room.scene_evidence", lambda *_, **__: evidence_of(room_of(turned(BOX, 0.2)))
    )
    output = run(context(image, tmp_path, level="off"))
    assert "panorama" not in output.artifacts
    assert result[0] == pytest.approx(-0.2, abs=0.02)
    assert output.metrics["walls_azimuth_deg"] == pytest.approx(np.degrees(-0.2), abs=1)


@pytest.mark.usefixtures("by_hand")
def test_a_given_room_stands_and_is_checked(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    write_room(path, room_of(BOX))
    image = calibrated(painted(room_of(BOX), 256))
    output = run(context(image, tmp_path, room=path))
    assert output.artifacts["room"].source == "given"
    assert output.left_out["estimate"] == "the room is given"
    assert output.artifacts["evidence"]
    path.write_text(path.read_text().replace('"given"', '"starter"'))
    with pytest.raises(RoomError, match="starter"):
        run(context(image, tmp_path, room=path))


@pytest.mark.usefixtures("by_hand")
def test_a_layout_network_takes_the_boundaries_place(tmp_path: Path) -> None:
    image = calibrated(painted(room_of(BOX), 256))
    output = run(context(image, tmp_path, layout_model=NETWORKS / "led2net.onnx", level="off"))
    assert "LED2-Net" in output.metrics["source"]
    corners = np.abs(np.array(output.artifacts["room"].floor))
    np.testing.assert_allclose(corners, np.tile((2.4, 1.6), (4, 1)), atol=0.1)


@pytest.mark.usefixtures("by_hand")
def test_a_picture_without_a_room_leaves_it_out_and_says_why(tmp_path: Path) -> None:
    black = calibrated(picture_of(np.zeros((64, 128))))
    output = run(context(black, tmp_path))
    assert "room" not in output.artifacts
    assert all("ROO-002" in output.left_out[name] for name in ("room", "panorama", "evidence"))
    assert "ROO-002" in output.warnings[0].message
    path = tmp_path / "mine.json"
    write_room(path, room_of(BOX))
    assert run(context(black, tmp_path, room=path)).artifacts["room"].source == "given"


def test_the_network_that_is_shipped_serves(tmp_path: Path) -> None:
    image = painted(room_of(BOX), 256)
    noisy = image.rgb * np.random.default_rng(2).uniform(0.95, 1.05, image.rgb.shape).astype(np.float32)
    output = run(context(calibrated(replace(image, rgb=noisy)), tmp_path))
    found = read_evidence(tmp_path / "evidence.npz")
    assert found.probabilities.shape[0] == 8
    assert ("room" in output.artifacts) != ("room" in output.left_out)
