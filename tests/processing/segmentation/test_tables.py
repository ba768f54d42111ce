"""Tables of published class names: all of them mean something, in the right order."""

from __future__ import annotations

import numpy as np
import pytest

from mocks.rooms.model import ADE20K as MOCK_NAMES
from processing.errors import SegmenterError
from processing.segmentation.adapters import ADE20K, ADE20K_TABLE, KNOWN, VOC, VOC_TABLE, class_matrix
from processing.segmentation.evidence import SceneClass


def test_sizes_and_uniqueness() -> None:
    assert (len(ADE20K), len(set(ADE20K))) == (150, 150)
    assert (len(VOC), len(set(VOC))) == (21, 21)


@pytest.mark.parametrize("known", sorted(KNOWN))
def test_every_class_means_something_and_nothing_else_is_listed(known: str) -> None:
    names, table = KNOWN[known]
    assert set(table) == set(names)
    matrix = class_matrix(names, table)
    assert matrix.shape == (len(names), len(SceneClass))
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, rtol=1e-6)


def test_indices_are_those_of_the_data_set() -> None:
    """Against the simulated rooms' own table, written apart from ours, and landmarks of the published list."""
    assert len(MOCK_NAMES) > 10
    for name, index in MOCK_NAMES.items():
        assert ADE20K[index] == name
    landmarks = {
        0: "wall",
        3: "floor",
        5: "ceiling",
        7: "bed",
        8: "windowpane",
        14: "door",
        146: "radiator",
        149: "flag",
    }
    assert {i: ADE20K[i] for i in landmarks} == landmarks
    assert {i: VOC[i] for i in (0, 9, 11, 16, 18, 20)} == {
        0: "background",
        9: "chair",
        11: "diningtable",
        16: "pottedplant",
        18: "sofa",
        20: "tvmonitor",
    }


def test_meanings() -> None:
    one = {name: kinds[0] for name, kinds in ADE20K_TABLE.items()}
    for name in ("sky", "ship", "waterfall", "traffic light", "lake", "van", "hill", "tree"):
        assert one[name] is SceneClass.WINDOW, "outdoors is seen through a window"
    for name in ("bed", "desk", "wardrobe", "swivel chair", "television", "plant"):
        assert one[name] is SceneClass.FURNITURE
    for name in ("curtain", "rug", "radiator", "painting", "mirror", "chandelier", "blind"):
        assert one[name] is SceneClass.FIXTURE
    assert SceneClass.FURNITURE not in VOC_TABLE["background"]
    assert len(VOC_TABLE["background"]) == len(SceneClass) - 1


def test_unknown_names_are_reported() -> None:
    with pytest.raises(SegmenterError, match="unicorn") as caught:
        class_matrix(("wall", "unicorn"), ADE20K_TABLE)
    assert caught.value.details["classes"] == ["unicorn"]
