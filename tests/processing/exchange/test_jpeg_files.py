"""JPEG with XMP: read back by Pillow and by exiv2."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from processing.errors import ParameterError
from processing.exchange.jpeg_files import STAGED_SOURCE, Made, PanoramaTags, jpeg_bytes, lit_by, packet, write_jpeg
from processing.pictures.panorama import read_panorama
from processing.sphere import Equirectangular


def picture(width: int = 64, height: int = 32) -> np.ndarray:
    rng = np.random.default_rng(5)
    return np.repeat(np.repeat(rng.integers(0, 256, (height // 8, width // 8, 3), np.uint8), 8, 0), 8, 1)


def xmp_of(path: Path) -> dict[str, object]:
    pyexiv2 = pytest.importorskip("pyexiv2", reason="the second reader of XMP is not installed")
    with pyexiv2.Image(str(path)) as image:
        return image.read_xmp()


def test_exiv2_reads_the_panorama(tmp_path: Path) -> None:
    path = tmp_path / "p.jpg"
    write_jpeg(path, picture(), panorama=PanoramaTags.whole(64, 32, heading_rad=math.radians(-30)))
    result = xmp_of(path)
    assert result["Xmp.GPano.ProjectionType"] == "equirectangular"
    assert result["Xmp.GPano.FullPanoWidthPixels"] == result["Xmp.GPano.CroppedAreaImageWidthPixels"] == "64"
    assert result["Xmp.GPano.FullPanoHeightPixels"] == "32"
    assert float(str(result["Xmp.GPano.PoseHeadingDegrees"])) == pytest.approx(330)
    assert "Xmp.iptcExt.DigitalSourceType" not in result


def test_exiv2_reads_what_kind_of_picture_it_is(tmp_path: Path) -> None:
    path = tmp_path / "p.jpg"
    write_jpeg(path, picture(), made=Made.of("staged-1"), relative=True, title='Room "3" <one> & more')
    result = xmp_of(path)
    assert result["Xmp.iptcExt.DigitalSourceType"] == STAGED_SOURCE
    assert result["Xmp.dc.title"] == {'lang="x-default"': 'Room "3" <one> & more'}
    assert b'daylit:Units="relative"' in path.read_bytes()
    assert b"GPano:" not in path.read_bytes().replace(b"xmlns:GPano", b"")


@pytest.mark.parametrize(
    ("made", "plate", "words", "silent"),
    [
        (Made.of("room", original="a.jpg"), "", (), ("original", "computer")),
        (
            Made.of("Emptied", original="a.jpg"),
            "Furniture removed",
            ("removed digitally", "Unaltered original: a.jpg"),
            (),
        ),
        (Made.of("staged-2"), "Virtually staged", ("virtual", "removed digitally"), ("original:",)),
        (Made.of("Staged 2", removed=""), "Virtually staged", ("virtual",), ("removed",)),
        (Made.of("staged-2", removed="equipment"), "Virtually staged", ("virtual", "equipment"), ("own furniture",)),
        (Made.of("empty", removed="equipment"), "Retouched", ("equipment", "removed digitally"), ("urniture",)),
        (Made.of("room", removed="equipment", further="relit"), "Relit", ("another time",), ("removed",)),
        (Made.of("staged-1", further="relit"), "Virtually staged, relit", ("virtual", "another time"), ()),
        (
            Made.of("room", further="relit", original="b"),
            "Relit",
            ("another time", "original: b"),
            ("removed", "virtual"),
        ),
        (Made.of("empty", lit=False), "Furniture removed", ("removed digitally.",), ("recalculated", "|")),
        (Made.of("staged-1", lit=False), "Virtually staged", ("removed digitally.",), ("recalculated",)),
        (Made.of("staged-1", removed="", lit=False), "Virtually staged", ("is virtual.",), ("recalculated", "removed")),
        (Made.of("empty"), "Furniture removed", ("light recalculated without it.",), ("|",)),
        (Made.of("staged-1"), "Virtually staged", ("and the light recalculated.",), ("|",)),
        (Made.of("empty", further="computed view"), "Furniture removed, computed view", ("did not see",), ("virtual",)),
    ],
)
def test_one_place_says_what_a_picture_is(
    tmp_path: Path, made: Made, plate: str, words: tuple[str, ...], silent: tuple[str, ...]
) -> None:
    """Plate, statement, source type: all of what was done, nothing that was not."""
    assert made.plate == plate
    assert all(word in made.statement for word in words)
    assert not any(word in made.statement for word in silent)
    assert np.array_equal(made.on(picture()), picture()) == (not plate)
    write_jpeg(tmp_path / "p.jpg", made.on(picture()), made=made)
    found = xmp_of(tmp_path / "p.jpg") if plate else {}
    assert found.get("Xmp.iptcExt.DigitalSourceType") == (STAGED_SOURCE if plate else None)
    assert made.statement in str(found.get("Xmp.dc.description", ""))
    assert (b'daylit:Staged="True"' in (tmp_path / "p.jpg").read_bytes()) == (made.state == "staged")


def test_the_longest_address_fits_the_statement() -> None:
    longest = "https://" + "a" * 300
    more = [(state, one) for state in ("empty", "staged") for one in ("relit", "computed view")]
    every = [Made.of(state, further=one, original=longest) for state, one in more]
    assert all(longest.encode() in packet(64, 32, made=one) for one in every)


def test_crop_of_a_panorama(tmp_path: Path) -> None:
    path = tmp_path / "p.jpg"
    write_jpeg(path, picture(), panorama=PanoramaTags(128, 64, left_px=32, top_px=16))
    result = xmp_of(path)
    assert [result[f"Xmp.GPano.CroppedArea{name}Pixels"] for name in ("Left", "Top", "ImageWidth")] == [
        "32",
        "16",
        "64",
    ]
    with pytest.raises(ParameterError, match="beyond"):
        jpeg_bytes(picture(), panorama=PanoramaTags(128, 64, left_px=65))


def test_pixels_survive_and_nothing_is_said_where_there_is_nothing(tmp_path: Path) -> None:
    path = tmp_path / "p.jpg"
    write_jpeg(path, picture(), quality=95)
    with Image.open(path) as opened:
        assert np.abs(np.asarray(opened, int) - picture()).mean() < 3
        assert "xmp" not in opened.info


def test_control_characters_of_a_title_do_not_break_the_packet() -> None:
    import xml.etree.ElementTree as Tree

    data = jpeg_bytes(picture(), title="a\x00\x1b[31m\nb")
    packet = data[data.index(b"<x:xmpmeta") : data.index(b"</x:xmpmeta>") + 12]
    assert "a  [31m b" in "".join(Tree.fromstring(packet).itertext())


@pytest.mark.parametrize(
    ("rgb8", "more"),
    [
        (np.zeros((4, 8), np.uint8), {}),
        (np.zeros((4, 8, 3), np.float32), {}),
        (np.zeros((0, 8, 3), np.uint8), {}),
        (np.zeros((1, 65_501, 3), np.uint8), {}),
        (picture(), {"quality": 100}),
        (picture(), {"title": "x" * 601}),
    ],
)
def test_what_cannot_be_a_jpeg_is_refused(rgb8: np.ndarray, more: dict[str, object]) -> None:
    with pytest.raises(ParameterError):
        jpeg_bytes(rgb8, **more)


@pytest.mark.parametrize("tags", [(64, 64), (0, 0), (64, 32, -1), (64, 32, 0, 0, math.nan)])
def test_tags_that_cannot_be_are_refused(tags: tuple) -> None:
    with pytest.raises(ParameterError):
        PanoramaTags(*tags)


@pytest.mark.parametrize(
    ("state", "left_out", "skipped", "method", "lit"),
    [
        ("empty", {}, "", "differential", True),
        ("empty", {"lift": "shading is kept"}, "", "differential", False),
        ("staged-1", {"lift": "shading is kept"}, "", "differential", True),
        ("staged-1", {}, "nothing to remove", "global", True),
    ],
)
def test_light_is_said_to_be_recalculated_only_where_it_was(
    state: str, left_out: dict[str, str], skipped: str, method: str, lit: bool
) -> None:
    facts = {
        "remove": {"left_out": left_out, "skipped": skipped, "metrics": {}},
        "render": {"metrics": {"method": method}},
    }
    assert lit_by(state, facts.__getitem__) == lit


def test_a_panorama_of_a_hundredth_less_height_is_whole(tmp_path: Path) -> None:
    """As `read_panorama` takes them; a part of one is none."""
    write_jpeg(tmp_path / "p.jpg", np.zeros((398, 800, 3), np.uint8), panorama=PanoramaTags.whole(800, 398))
    assert b'FullPanoHeightPixels="398"' in (tmp_path / "p.jpg").read_bytes()
    assert read_panorama(tmp_path / "p.jpg").image.geometry == Equirectangular(800, 398)
    with pytest.raises(ParameterError, match="2:1"):
        PanoramaTags.whole(800, 390)
