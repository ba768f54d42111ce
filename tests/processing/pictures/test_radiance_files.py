"""Radiance files: what Radiance's tools read in them, round trips, damage."""

from __future__ import annotations

import math
import os
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from benchmarks.shared_data import DATA
from processing.calibration.scale.photometry import illuminance_lx
from processing.errors import PictureFileError
from processing.pictures.images import LuminanceImage, luminance_cd_m2
from processing.pictures.radiance import (
    RADIANCE_WEIGHTS,
    WHITE_EFFICACY_LM_W,
    RunLengthError,
    decode_rows,
    encode_rows,
    from_rgbe,
    geometry_of,
    read_radiance_hdr,
    to_rgbe,
    view_of,
    write_radiance_hdr,
)
from processing.sphere import (
    Equirectangular,
    Fisheye,
    Geometry,
    LensMapping,
    Perspective,
    directions,
    projected_solid_angles,
)
from tests.processing.pictures.picture_strategies import luminance_image

REFERENCE = "brackets/canon5d2_8mm_bracket/pipeline-output-1000x1000.hdr"
LIGHT = st.floats(0, 2.0**30, width=32, allow_subnormal=True)
BYTES = st.integers(0, 255) | st.sampled_from([0, 1, 2, 128, 255])


def lines_of(path: Path) -> list[str]:
    return path.read_bytes().split(b"\n\n")[0].decode("ascii").split("\n")


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.float32, st.tuples(st.integers(1, 5), st.integers(1, 20), st.just(3)), elements=LIGHT))
def test_code_is_right_to_a_step_and_again(rgb: np.ndarray) -> None:
    code = to_rgbe(rgb)
    back = from_rgbe(code)
    step = rgb.max(axis=2, keepdims=True) / 128
    assert (np.abs(back - rgb) <= step + 1e-32).all()
    assert (np.abs(from_rgbe(to_rgbe(back)) - back) <= back.max(axis=2, keepdims=True) / 128 + 1e-32).all()


def test_what_is_below_the_code_s_range_becomes_black() -> None:
    below = np.full((1, 1, 3), 9.99e-33, np.float32)
    assert not from_rgbe(to_rgbe(below)).any()
    assert from_rgbe(to_rgbe(below * 2)).all()


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(
        np.uint8, st.tuples(st.integers(1, 4), st.sampled_from([1, 7, 8, 9, 200, 300]), st.just(4)), elements=BYTES
    )
)
def test_run_lengths_come_back(rgbe: np.ndarray) -> None:
    rgbe[..., 0] |= 128  # as `to_rgbe` makes it, and no pixel that flat files could take for an old run
    rgbe[..., 3] = np.maximum(rgbe[..., 3], 24)
    rgbe[rgbe[..., 1] == 0] = 0
    height, width = rgbe.shape[:2]
    np.testing.assert_array_equal(decode_rows(encode_rows(rgbe), width, height), rgbe)


def test_runs_of_every_length() -> None:
    for length in (*range(1, 10), 126, 127, 128, 129, 130, 131, 254, 255, 256, 1000):
        row = np.zeros((1, 1003, 4), np.uint8)
        row[0, 2 : 2 + length] = (200, 9, 9, 130)
        np.testing.assert_array_equal(decode_rows(encode_rows(row), 1003, 1), row)


def test_header_is_what_evalglare_needs(tmp_path: Path) -> None:
    path = tmp_path / "picture.hdr"
    write_radiance_hdr(path, luminance_image(np.ones((16, 16, 3)), Fisheye(16, 16, LensMapping.EQUIDISTANT, 8.0)))
    lines = lines_of(path)
    assert lines[0] == "#?RADIANCE"
    assert "EXPOSURE=1" in lines
    assert [line for line in lines if line.startswith("VIEW=")] == [
        "VIEW= -vta -vp 0 0 0 -vd 0 0 1 -vu 0 1 0 -vh 180 -vv 180"
    ]
    write_radiance_hdr(path, luminance_image(np.ones((8, 16, 3))))
    assert not [line for line in lines_of(path) if "VIEW" in line]


def test_views_of_other_geometries() -> None:
    turned = view_of(Fisheye(16, 16, LensMapping.ORTHOGRAPHIC, 8.0, top_azimuth_rad=math.pi / 2), "x")
    assert turned == "-vth -vp 0 0 0 -vd 0 0 1 -vu 1 0 0 -vh 180 -vv 180"
    wide = view_of(Fisheye(16, 16, LensMapping.EQUIDISTANT, 8.0, math.radians(93)), "x")
    assert wide.endswith("-vh 186 -vv 186")
    loose = view_of(Fisheye(20, 20, LensMapping.EQUIDISTANT, 8.0), "x")
    assert loose.endswith("-vh 225 -vv 225")
    ahead = view_of(Perspective(20, 20, math.pi / 2, math.pi / 2), "x")
    assert ahead == "-vtv -vp 0 0 0 -vd 1 0 0 -vu 0 0 1 -vh 90 -vv 90"


@pytest.mark.parametrize(
    "geometry",
    [
        Fisheye(16, 16, LensMapping.EQUIDISTANT, 8.0),
        Fisheye(16, 16, LensMapping.EQUIDISTANT, 8.0, math.radians(93), None, -2.0),
        Fisheye(16, 16, LensMapping.ORTHOGRAPHIC, 8.0, math.pi / 2, None, 1.25),
    ],
    ids=str,
)
def test_views_come_back(geometry: Fisheye) -> None:
    back = geometry_of(view_of(geometry, "x"), 16, 16)
    assert back is not None
    assert (back.mapping, back.radius_px) == (geometry.mapping, 8.0)
    assert back.half_field_rad == pytest.approx(geometry.half_field_rad, abs=1e-9)
    assert back.top_azimuth_rad == pytest.approx(geometry.top_azimuth_rad, abs=1e-9)


@pytest.mark.parametrize(
    "view",
    [
        "",
        "-vta",
        "-vta -vh 180",
        "-vta -vh 180 -vv",
        "-vta -vh 180 -vv 90",
        "-vta -vh 400 -vv 400",
        "-vth -vh 190 -vv 190",
        "-vta -vh x -vv x",
        "-vtv -vh 60 -vv 60",
        "-vta -vd 0 1 0 -vh 180 -vv 180",
        "-vta -vd 0 0 -1 -vh 180 -vv 180",
        "-vta -vd 0 0 -vh 180 -vv 180",
    ],
)
def test_views_that_are_no_fisheye_upwards(view: str) -> None:
    assert geometry_of(view, 16, 16) is None
    assert geometry_of("-vta -vh 180 -vv 180", 16, 12) is None


@pytest.mark.shared(REFERENCE)
def test_reference_map_of_others() -> None:
    """Their own tool's value, by Radiance's weights; ours are those of Rec. 709."""
    found = read_radiance_hdr(DATA / REFERENCE)
    assert isinstance(found.geometry, Fisheye)
    luminance = found.rgb @ np.array(RADIANCE_WEIGHTS, np.float32)
    weights = projected_solid_angles(found.geometry, (0, 0, 1))
    assert float((weights * luminance).sum()) == pytest.approx(900.936, rel=1e-3)


@pytest.mark.parametrize(
    "geometry",
    [
        Fisheye(16, 16, LensMapping.EQUISOLID, 8.0),
        Fisheye(20, 16, LensMapping.EQUIDISTANT, 8.0),
        Fisheye(16, 16, LensMapping.EQUIDISTANT, 7.0, centre_px=(7.5, 8.0)),
        Fisheye(20, 20, LensMapping.ORTHOGRAPHIC, 8.0),
        Perspective(16, 16, 1.0, roll_rad=0.1),
    ],
    ids=str,
)
def test_geometry_without_a_view_is_refused(tmp_path: Path, geometry: Geometry) -> None:
    image = luminance_image(np.ones((geometry.height_px, geometry.width_px, 3)), geometry)
    with pytest.raises(PictureFileError, match="no view"):
        write_radiance_hdr(tmp_path / "picture.hdr", image)
    assert not list(tmp_path.iterdir())


def test_round_trip_keeps_light_and_colour(tmp_path: Path) -> None:
    rgb = np.random.default_rng(2).lognormal(3, 2, (64, 128, 3)).astype(np.float32)
    rgb[:3] = 0
    rgb[5, 6] = 1.6e9
    write_radiance_hdr(tmp_path / "picture.hdr", luminance_image(rgb))
    back = read_radiance_hdr(tmp_path / "picture.hdr")
    assert back.exposure == 1.0
    assert (back.rgb[:3] == 0).all()
    assert (np.abs(back.rgb - rgb) <= rgb.max(axis=2, keepdims=True) / 60).all()
    assert np.mean(back.rgb[10:], dtype=np.float64) == pytest.approx(np.mean(rgb[10:], dtype=np.float64), rel=2e-3)


def test_an_even_surface_keeps_its_mean(tmp_path: Path) -> None:
    for value in (22.4, 22.9126, 100.0, 179.0):
        rgb = np.full((40, 80, 3), value, np.float32) * np.array([1, 0.6, 0.2], np.float32)
        write_radiance_hdr(tmp_path / "even.hdr", luminance_image(rgb))
        back = read_radiance_hdr(tmp_path / "even.hdr").rgb
        np.testing.assert_allclose(back.mean(axis=(0, 1), dtype=np.float64), rgb[0, 0], rtol=1e-3)


def test_other_readers_find_the_same_pixels(tmp_path: Path) -> None:
    rgb = np.full((16, 32, 3), 179.0, np.float32) * np.linspace(0.1, 5, 32, dtype=np.float32)[None, :, None]
    write_radiance_hdr(tmp_path / "grey.hdr", luminance_image(rgb))
    theirs = cv2.imread(str(tmp_path / "grey.hdr"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    np.testing.assert_allclose(theirs * WHITE_EFFICACY_LM_W, rgb, rtol=0.012)


def test_files_of_others_exposure_and_size(tmp_path: Path) -> None:
    path = tmp_path / "theirs.hdr"
    rgb = np.random.default_rng(0).uniform(0.5, 2, (9, 33, 3)).astype(np.float32)
    cv2.imwrite(str(path), rgb[..., ::-1])
    data = path.read_bytes()
    plain = read_radiance_hdr(path)
    np.testing.assert_allclose(plain.rgb, rgb * WHITE_EFFICACY_LM_W, rtol=0.02)
    path.write_bytes(
        data.replace(b"FORMAT", b"EXPOSURE=2.0\nEXPOSURE= 4\nVIEW= -vta -vv 180 -vh 180\nFORMAT", 1)
        # As Radiance's own tools write it.
        .replace(b"-Y 9 +X 33", b"-Y        9 +X       33")
    )
    twice = read_radiance_hdr(path)
    assert (twice.exposure, twice.view) == (8.0, "-vta -vv 180 -vh 180")
    np.testing.assert_allclose(twice.rgb, plain.rgb / 8, rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"#?RADIANCE", b"RADIANCE"),
        (b"-Y 16 +X 32", b"+Y 16 +X 32"),
        (b"-Y 16 +X 32", b"-Y 99999999 +X 99999999"),
        (b"-Y 16 +X 32", b"-Y 17 +X 32"),
        (b"-Y 16 +X 32", b"-Y 15 +X 32"),
        (b"-Y 16 +X 32", b"-Y 16 +X 33"),
        (b"-Y 16 +X 32", b"-Y 0 +X 32"),
        (b"rle_rgbe", b"rle_xyze"),
        (b"EXPOSURE=1", b"EXPOSURE=0"),
        (b"EXPOSURE=1", b"EXPOSURE=nan"),
        (b"EXPOSURE=1", b"EXPOSURE=one"),
        # All of it 0, and none of it a number.
        (b"EXPOSURE=1", b"EXPOSURE=1e300"),
        (b"EXPOSURE=1", b"EXPOSURE=1e-300"),
        (b"EXPOSURE=1", b"EXPOSURE=1e-320"),
        (b"EXPOSURE=1", b"COLORCORR= 1 .5 1"),
        (b"EXPOSURE=1", b"COLORCORR= 1 one 1"),
        (b"EXPOSURE=1", b"PRIMARIES= .708 .292 .17 .797 .131 .046 .3127 .329"),
        (b"EXPOSURE=1", b"PRIMARIES= .64 .33"),
        (b"EXPOSURE=1", b"PRIMARIES= 0 0"),
        (b"EXPOSURE=1", b"COLORCORR= 0 0 0"),
        (b"\n\n", b"\n"),
    ],
)
def test_headers_that_cannot_be_taken(tmp_path: Path, old: bytes, new: bytes) -> None:
    path = tmp_path / "picture.hdr"
    rng = np.random.default_rng(0)
    write_radiance_hdr(path, luminance_image(rng.uniform(1, 2, (16, 32, 3))))
    data = path.read_bytes()
    assert old in data
    path.write_bytes(data.replace(old, new, 1))
    with pytest.raises(PictureFileError):
        read_radiance_hdr(path)


@pytest.mark.parametrize(
    "line",
    [
        "COLORCORR= 1.000000 1.000000 1.000000",
        "PRIMARIES= 0.640 0.330 0.300 0.600 0.150 0.060 0.3127 0.3290",
        "PRIMARIES= .6400 .3300 .2900 .6000 .1500 .0600 .3333 .3333",
        "PRIMARIES=0 0 0 0 0 0 0 0",  # Photoshop's, where it states none
    ],
)
def test_headers_that_say_what_is_taken_anyway(tmp_path: Path, line: str) -> None:
    path = tmp_path / "picture.hdr"
    write_radiance_hdr(path, luminance_image(np.random.default_rng(0).uniform(1, 2, (16, 32, 3))))
    plain = read_radiance_hdr(path).rgb
    path.write_bytes(path.read_bytes().replace(b"EXPOSURE=1", b"EXPOSURE=1\n" + line.encode(), 1))
    np.testing.assert_array_equal(read_radiance_hdr(path).rgb, plain)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.floats(0, 0.999), flip=st.integers(0, 2**20))
def test_cuts_are_found_and_flips_never_crash(tmp_path: Path, cut: float, flip: int) -> None:
    """RGBE has no checksum: a flipped mantissa is another colour; but all that is read is finite light."""
    path = tmp_path / "picture.hdr"
    write_radiance_hdr(path, luminance_image(np.random.default_rng(0).uniform(1, 2, (16, 32, 3))))
    data = path.read_bytes()
    path.write_bytes(data[: int(cut * len(data))])
    with pytest.raises(PictureFileError):
        read_radiance_hdr(path)
    bad = bytearray(data)
    bad[flip // 8 % len(bad)] ^= 1 << (flip % 8)
    path.write_bytes(bad)
    try:
        assert np.isfinite(read_radiance_hdr(path).rgb).all()
    except PictureFileError:
        pass


def test_old_run_lengths_are_refused_by_name() -> None:
    flat = np.full((1, 4, 4), 7, np.uint8)
    flat[0, 2] = (1, 1, 1, 2)
    with pytest.raises(RunLengthError, match="1991"):
        decode_rows(flat.tobytes(), 4, 1)


def test_impossible_light_is_not_written(tmp_path: Path) -> None:
    rgb = np.ones((8, 16, 3), np.float32)
    rgb[1, 1, 1] = np.nan
    with pytest.raises(PictureFileError):
        write_radiance_hdr(tmp_path / "picture.hdr", luminance_image(rgb))


def tool(name: str) -> str:
    pyradiance = pytest.importorskip("pyradiance", reason="an oracle of the bench extra")
    return os.path.join(os.path.dirname(pyradiance.__file__), "bin", name)


def sky(geometry: Fisheye, kind: str) -> LuminanceImage:
    """Return a hemisphere of a known sky: even, CIE overcast, or blue with a bright cloud."""
    towards, seen = directions(geometry)
    height = np.clip(towards[..., 2], 0, 1)
    level = {"even": np.full_like(height, 318.3), "overcast": 1000 * (1 + 2 * height) / 3}.get(kind)
    if level is None:
        level = 300 + 20_000.0 * (towards @ (0.6, 0.0, 0.8) > math.cos(math.radians(12)))
    colour = (0.6, 1.0, 1.9) if kind == "blue" else (1.0, 1.0, 1.0)
    rgb = np.where(seen[..., None], level[..., None] * np.array(colour), 0).astype(np.float32)
    return luminance_image(rgb, geometry, validity=np.where(seen, 0, 3).astype(np.uint8))


@pytest.mark.parametrize(
    ("mapping", "kind"),
    [(LensMapping.EQUIDISTANT, "overcast"), (LensMapping.ORTHOGRAPHIC, "blue"), (LensMapping.ORTHOGRAPHIC, "even")],
)
def test_evalglare_finds_our_illuminance(tmp_path: Path, mapping: LensMapping, kind: str) -> None:
    image = sky(Fisheye(600, 600, mapping, 300.0), kind)
    path = tmp_path / "sky.hdr"
    write_radiance_hdr(path, image)
    answer = subprocess.run([tool("evalglare"), "-V", str(path)], capture_output=True, text=True, check=False)
    assert answer.stdout, answer.stderr
    ours = illuminance_lx(image).value_lx
    assert float(answer.stdout.split()[0]) == pytest.approx(ours, rel=0.005)


def test_pvalue_finds_our_luminance(tmp_path: Path) -> None:
    """The weights of ``pvalue -b`` and of falsecolor are Radiance's: saturated colours come out right, too."""
    rgb = np.zeros((8, 48, 3), np.float32)
    rgb[:, :16], rgb[:, 16:32], rgb[:, 32:] = (900, 60, 20), (100, 800, 50), (20, 30, 700)
    write_radiance_hdr(tmp_path / "colours.hdr", luminance_image(rgb, Equirectangular(48, 8)))
    answer = subprocess.run(
        [tool("pvalue"), "-h", "-H", "-d", "-b", str(tmp_path / "colours.hdr")],
        capture_output=True,
        text=True,
        check=True,
    )
    values = np.array([float(v) for v in answer.stdout.split()]).reshape(8, 48) * WHITE_EFFICACY_LM_W
    means = values.reshape(8, 3, 16).mean(axis=(0, 2))
    np.testing.assert_allclose(means, luminance_cd_m2(rgb[0, ::16]), rtol=0.01)


@pytest.mark.parametrize("absolute", [True, False])
def test_the_header_says_whether_values_are_cd_m2(tmp_path: Path, absolute: bool) -> None:
    image = luminance_image(np.full((4, 8, 3), 7.0), absolute=absolute)
    write_radiance_hdr(tmp_path / "p.hdr", image)
    assert read_radiance_hdr(tmp_path / "p.hdr").absolute is absolute
