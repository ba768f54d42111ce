from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from processing.errors import LayoutNetworkError, ParameterError
from processing.pictures.images import RelativeImage
from processing.room.columns import columns_of
from processing.room.hypotheses import hypotheses
from processing.room.layout_networks import LayoutNetwork, layout_boundary, load_layout_network
from processing.sphere import Perspective
from tests.processing.room.evidence import picture_of

NETWORKS = Path(__file__).parent / "networks"
PICTURE = picture_of(np.random.default_rng(1).uniform(0.1, 1.0, (64, 128)))


@pytest.mark.parametrize(
    ("name", "kind", "count"),
    [("horizonnet", "HorizonNet", 1024), ("led2net", "LED2-Net", 1024), ("lgtnet", "LGT-Net", 256)],
)
def test_each_kind_is_recognised_by_its_shapes_and_gives_the_same_box(name: str, kind: str, count: int) -> None:
    network = load_layout_network(NETWORKS / f"{name}.onnx")
    assert network.kind == kind
    found = layout_boundary(PICTURE, network)
    assert found.floor_rad.shape == (count,)
    assert (found.ceiling_rad > 0).all()
    assert (found.floor_rad < 0).all()
    box = hypotheses(columns_of(found), 0.0)[0].fit
    low, high = box.polygon.min(axis=0), box.polygon.max(axis=0)
    np.testing.assert_allclose(np.concatenate([low, high]), (-1.5, -1.0, 1.5, 1.0), atol=0.02)
    assert box.outline.ratio == pytest.approx(0.6, abs=0.01)


def test_corners_are_probabilities() -> None:
    found = layout_boundary(PICTURE, load_layout_network(NETWORKS / "horizonnet.onnx"))
    assert found.corner[0] == pytest.approx(1 / (1 + math.exp(-4)), abs=1e-4)
    assert found.corner[1] == pytest.approx(1 / (1 + math.exp(4)), abs=1e-4)


@pytest.mark.parametrize("name", ["led2net", "lgtnet"])
def test_the_answer_is_turned_back_with_the_picture(name: str) -> None:
    network = load_layout_network(NETWORKS / f"{name}.onnx")
    straight, turned = layout_boundary(PICTURE, network), layout_boundary(PICTURE, network, turn_rad=math.pi / 8)
    columns = len(straight.floor_rad) // 16
    # What the network sees straight ahead lies a sixteenth of a turn to the right in the picture.
    np.testing.assert_allclose(turned.floor_rad, np.roll(straight.floor_rad, columns))


class Stripes:
    """Stands in for LGT-Net's session: the distance of each of its 256 columns is how bright the picture is there."""

    def run(self, _outputs, fed):
        bright = fed["x"][0].mean(axis=(0, 1)).reshape(256, 4).mean(axis=1)
        return [1 + bright[None], np.full((1, 1), 0.6)]


@pytest.mark.parametrize("turn_rad", [0.0123, -0.5, 0.6999, 2.0])
def test_answers_of_fewer_columns_than_the_picture_are_turned_back_just_as_far(turn_rad: float) -> None:
    rng = np.random.default_rng(3)
    wide = picture_of(np.tile(rng.uniform(0.1, 1.0, 256).repeat(4), (512, 1)))
    network = LayoutNetwork("LGT-Net", "x", ("depth", "ratio"), Stripes(), "stripes")
    straight = layout_boundary(wide, network)
    np.testing.assert_allclose(layout_boundary(wide, network, turn_rad=turn_rad).floor_rad, straight.floor_rad)
    assert np.ptp(straight.floor_rad) > 0.1


def test_other_networks_and_files_are_refused_with_what_was_found(tmp_path: Path) -> None:
    with pytest.raises(LayoutNetworkError, match="224"):
        load_layout_network(NETWORKS / "classifier.onnx")
    with pytest.raises(LayoutNetworkError, match="angles"):
        layout_boundary(PICTURE, load_layout_network(NETWORKS / "pixels.onnx"))
    junk = tmp_path / "junk.onnx"
    junk.write_bytes(b"no network")
    with pytest.raises(LayoutNetworkError, match="cannot be loaded"):
        load_layout_network(junk)
    with pytest.raises(LayoutNetworkError, match="cannot be read"):
        load_layout_network(tmp_path / "none.onnx")


def test_only_whole_panoramas_are_taken() -> None:
    view = RelativeImage(PICTURE.rgb, PICTURE.uncertainty, PICTURE.validity, Perspective(128, 64, 1.0))
    with pytest.raises(ParameterError):
        layout_boundary(view, load_layout_network(NETWORKS / "led2net.onnx"))
