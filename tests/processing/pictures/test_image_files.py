"""OpenEXR files: every field comes back, damage does not, nor does a half-written file stay."""

from __future__ import annotations

import ctypes
import errno
import json
import os
import struct
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from hypothesis import HealthCheck, given, settings

from processing.errors import PictureFileError
from processing.pictures.exr import ZSTD_LEVEL, read_exr, read_exr_rgb, write_exr, write_stage_exr
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.writing import write_whole
from processing.sphere import Equirectangular
from station.errors import DiskError, DiskFullError
from station.session import durable
from tests.processing.pictures.picture_strategies import images, luminance_image

SUN_CD_M2 = 1.6e9


def assert_same(one: object, other: object) -> None:
    assert type(one) is type(other)
    for field in fields(one):  # type: ignore[arg-type]
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
        else:
            assert a == b, field.name


def noise(height: int = 64, width: int = 128) -> LuminanceImage:
    rng = np.random.default_rng(3)
    return luminance_image(
        rng.lognormal(2, 2, (height, width, 3)).astype(np.float32),
        uncertainty=rng.uniform(0.001, 0.1, (height, width)).astype(np.float32),
        validity=rng.integers(0, 5, (height, width)).astype(np.uint8),
        ghost=rng.integers(0, 3, (height, width)).astype(np.uint8),
        scale_uncertainty=0.0123,
        attributes={"k1": 0.0339828, "k2": 1 / 2.117, "side": "indoor"},
    )


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(image=images())
def test_all_fields_come_back(tmp_path: Path, image: RelativeImage | LuminanceImage) -> None:
    path = tmp_path / "picture.exr"
    write_exr(path, image)
    assert_same(read_exr(path), image)
    first = path.read_bytes()
    write_exr(path, image)
    assert path.read_bytes() == first
    assert [p.name for p in tmp_path.iterdir()] == ["picture.exr"]


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(image=images())
def test_what_stages_hand_on_is_what_their_files_hold(tmp_path: Path, image: RelativeImage | LuminanceImage) -> None:
    path = tmp_path / "picture.exr"
    handed = write_stage_exr(path, image)
    assert_same(read_exr(path), handed)
    first = path.read_bytes()
    assert_same(write_stage_exr(path, handed), handed)
    assert path.read_bytes() == first
    np.testing.assert_allclose(handed.rgb, image.rgb, rtol=2.0**-14, atol=1e-39)
    usual = (image.uncertainty > 2**-14) & (image.uncertainty < 2**15)
    np.testing.assert_allclose(handed.uncertainty[usual], image.uncertainty[usual], rtol=2.0**-6)
    assert np.array_equal(np.isinf(handed.uncertainty), np.isinf(image.uncertainty))


def test_a_picture_of_ones_own_is_rounded_in_place_but_where_others_hold_it(tmp_path: Path) -> None:
    image, before = luminance_image(np.full((8, 16, 3), 1 / 3, np.float32)), np.float32(1 / 3)
    copied = write_stage_exr(tmp_path / "a.exr", image)
    assert (image.rgb == before).all()
    image.rgb.setflags(write=False)
    assert_same(write_stage_exr(tmp_path / "a.exr", image, own=True), copied)
    assert (image.rgb == before).all()
    image.rgb.setflags(write=True)
    mine = write_stage_exr(tmp_path / "a.exr", image, own=True)
    assert mine.rgb is image.rgb
    assert_same(mine, copied)


@pytest.mark.parametrize("uncertainty", [1e-7, 5e-5, 6.2e-5, 0.0103, 1.0, 65504.0, 1e30])
def test_an_uncertainty_stays_above_nothing_and_finite_in_a_half(tmp_path: Path, uncertainty: float) -> None:
    image = luminance_image(np.ones((8, 16, 3)), uncertainty=np.full((8, 16), uncertainty, np.float32))
    write_stage_exr(tmp_path / "a.exr", image)
    found = read_exr(tmp_path / "a.exr").uncertainty
    assert np.all(found == np.float16(found))
    assert found == pytest.approx(min(max(uncertainty, 2**-14), 2**15), rel=2**-6)


def test_a_file_is_packed_by_as_many_threads_as_asked_and_its_bytes_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    noise = np.random.default_rng(5).random((200, 400, 3)).astype(np.float32)
    for count in (1, 3):
        monkeypatch.setenv("DAYLIT_THREADS", str(count))
        write_stage_exr(tmp_path / f"{count}.exr", luminance_image(noise))
        assert OpenEXR.global_thread_count() == count
    assert (tmp_path / "1.exr").read_bytes() == (tmp_path / "3.exr").read_bytes()


def test_stage_files_are_packed_at_our_level(tmp_path: Path) -> None:
    write_stage_exr(tmp_path / "a.exr", noise())
    level = ctypes.c_int()
    try:
        ask = ctypes.CDLL(OpenEXR.__file__).exr_get_default_zstd_compression_level
    except AttributeError:
        pytest.skip("this build of OpenEXR does not show its C interface")
    ask(ctypes.byref(level))
    assert level.value == ZSTD_LEVEL


def test_flipped_bits_of_a_stage_file_are_seen(tmp_path: Path) -> None:
    path = tmp_path / "a.exr"
    write_stage_exr(path, noise())
    whole = path.read_bytes()
    for place in range(len(whole) // 3, len(whole), len(whole) // 97):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(PictureFileError):
            read_exr(path)


def test_the_sun_beside_a_wall_is_exact(tmp_path: Path) -> None:
    rgb = np.ones((8, 16, 3), np.float32)
    rgb[2, 3] = SUN_CD_M2
    write_exr(tmp_path / "sun.exr", luminance_image(rgb))
    back = read_exr(tmp_path / "sun.exr").rgb
    assert back[2, 3].tolist() == [np.float32(SUN_CD_M2)] * 3
    assert back[2, 4].tolist() == [1.0, 1.0, 1.0]


def test_smallest_picture_and_strided_arrays(tmp_path: Path) -> None:
    big = noise(16, 32)
    view = luminance_image(big.rgb[::2, ::-2], uncertainty=big.uncertainty[::2, ::-2], validity=big.validity[::2, ::-2])
    write_exr(tmp_path / "view.exr", view)
    assert_same(read_exr(tmp_path / "view.exr"), view)


def test_other_programs_find_what_the_standard_says(tmp_path: Path) -> None:
    path = tmp_path / "picture.exr"
    write_exr(path, noise())
    with OpenEXR.File(str(path)) as file:
        header = dict(file.header())
        assert set(file.channels()) == {"RGB", "uncertainty", "validity", "ghost"}
        assert file.channels()["RGB"].pixels.dtype == np.float32
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert header["whiteLuminance"] == 1.0
    np.testing.assert_allclose(header["chromaticities"], (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329))
    assert json.loads(header["daylitProvenance"])["k2"] == 1 / 2.117
    rgb, white = read_exr_rgb(path)
    np.testing.assert_array_equal(rgb, noise().rgb)
    assert white == 1.0


def test_a_relative_picture_has_no_white_luminance(tmp_path: Path) -> None:
    image = noise()
    relative = RelativeImage(image.rgb, image.uncertainty, image.validity, image.geometry)
    write_exr(tmp_path / "r.exr", relative)
    assert read_exr_rgb(tmp_path / "r.exr")[1] is None
    assert isinstance(read_exr(tmp_path / "r.exr"), RelativeImage)


def test_a_picture_in_relative_units_stays_one_and_claims_no_cd_m2(tmp_path: Path) -> None:
    image = replace(noise(), absolute=False)
    write_exr(tmp_path / "r.exr", image)
    assert read_exr_rgb(tmp_path / "r.exr")[1] is None
    back = read_exr(tmp_path / "r.exr")
    assert isinstance(back, LuminanceImage)
    assert not back.absolute
    assert back.unit == "relative units"
    assert noise().unit == "cd/m2"


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1e-6])
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_impossible_light_is_not_written(tmp_path: Path, value: float, channel: int) -> None:
    image = noise()
    image.rgb[63, 5, channel] = value
    with pytest.raises(PictureFileError, match=rf"{'RGB'[channel]} of the pixel in column 5, row 63"):
        write_exr(tmp_path / "picture.exr", image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "change",
    [
        {"uncertainty": np.zeros((64, 128), np.float32)},
        {"uncertainty": np.full((64, 128), np.nan, np.float32)},
        {"uncertainty": np.full((64, 127), 0.1, np.float32)},
        {"uncertainty": np.full((64, 128), 0.1, np.float64)},
        {"validity": np.full((64, 128), 5, np.uint8)},
        {"validity": np.zeros((64, 128), np.int32)},
        {"ghost": np.zeros((63, 128), np.uint8)},
        {"geometry": Equirectangular(64, 32)},
        {"scale_uncertainty": float("nan")},
        {"scale_uncertainty": -0.1},
        {"attributes": {"k1": float("nan")}},
        {"attributes": {"k1": object}},
    ],
    ids=str,
)
def test_a_picture_that_breaks_its_promise_is_not_written(tmp_path: Path, change: dict[str, object]) -> None:
    with pytest.raises(PictureFileError):
        write_exr(tmp_path / "picture.exr", replace(noise(), **change))
    assert not list(tmp_path.iterdir())


def foreign(path: Path, channels: dict[str, np.ndarray], **header: object) -> None:
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header, channels).write(
        str(path)
    )


@pytest.mark.parametrize("value", [np.nan, np.inf, -5.0])
def test_impossible_light_is_not_read(tmp_path: Path, value: float) -> None:
    rgb = np.ones((8, 16, 3), np.float32)
    rgb[3, 4, 1] = value
    foreign(tmp_path / "f.exr", {"RGB": rgb})
    with pytest.raises(PictureFileError, match="impossible light"):
        read_exr_rgb(tmp_path / "f.exr")


@pytest.mark.parametrize("name", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "DWAA", "B44"])
def test_pictures_of_other_programs(tmp_path: Path, name: str) -> None:
    rgb = np.random.default_rng(1).lognormal(0, 1, (40, 60, 3)).astype(np.float32)
    rgb[:4] = 0
    compression = getattr(OpenEXR, f"{name}_COMPRESSION")
    foreign(tmp_path / "f.exr", {"RGB": rgb.astype(np.float16)}, compression=compression, whiteLuminance=80.0)
    back, white = read_exr_rgb(tmp_path / "f.exr")
    assert white == 80.0
    assert back.min() >= 0
    assert np.median(np.abs(back - rgb)) < 0.05
    with pytest.raises(PictureFileError, match="not written by daylit"):
        read_exr(tmp_path / "f.exr")


def test_other_channels_primaries_parts_and_layouts_are_refused(tmp_path: Path) -> None:
    rgb, path = np.ones((8, 16, 3), np.float32), tmp_path / "f.exr"
    foreign(path, {"Y": rgb[..., 0].copy()})
    with pytest.raises(PictureFileError, match="channels Y, not R, G and B"):
        read_exr_rgb(path)
    foreign(path, {"RGB": rgb}, chromaticities=(0.7, 0.29, 0.17, 0.8, 0.13, 0.05, 0.31, 0.33))
    with pytest.raises(PictureFileError, match="primaries"):
        read_exr_rgb(path)
    foreign(path, {"RGB": rgb}, whiteLuminance=-1.0)
    with pytest.raises(PictureFileError, match="whiteLuminance"):
        read_exr_rgb(path)
    window = (np.array([0, 0], np.int32), np.array([31, 31], np.int32))
    foreign(path, {"RGB": rgb}, displayWindow=window)
    with pytest.raises(PictureFileError, match=r"is cropped .* do: save the whole picture"):
        read_exr_rgb(path)
    parts = [OpenEXR.Part({"type": OpenEXR.scanlineimage}, {"RGB": rgb}, name) for name in "ab"]
    OpenEXR.File(parts).write(str(path))
    with pytest.raises(PictureFileError, match=r"is of several parts .* do: save .* as one part"):
        read_exr_rgb(path)


def test_light_that_is_transparent_is_refused(tmp_path: Path) -> None:
    """A renderer's transparent film leaves light 0 where the windows are."""
    rgba, path = np.ones((8, 16, 4), np.float32), tmp_path / "f.exr"
    foreign(path, {"RGBA": rgba})
    assert np.array_equal(read_exr_rgb(path)[0], rgba[..., :3])
    rgba[2:4, 4:8] = 0
    foreign(path, {"RGBA": rgba.astype(np.float16)})
    with pytest.raises(PictureFileError, match=r"6\.2% of it is transparent.*film transparent"):
        read_exr_rgb(path)


def test_fewer_samples_than_pixels_are_named_so(tmp_path: Path) -> None:
    rgb, path = np.ones((8, 16, 3), np.float32), tmp_path / "f.exr"
    foreign(path, {"RGB": rgb})
    data = bytearray(path.read_bytes())
    # Of the channel list's first entry: name, type, linearity, then steps in x and y.
    place = data.index(b"chlist\0") + len(b"chlist\0") + 4 + len(b"B\0") + 8
    assert data[place : place + 4] == b"\1\0\0\0"
    data[place] = 2
    path.write_bytes(data)
    with pytest.raises(PictureFileError, match=r"is subsampled .* do: save .* at full size"):
        read_exr_rgb(path)


def test_layers_are_named_and_looked_past(tmp_path: Path) -> None:
    rgb, path = np.full((8, 16, 3), 2, np.float32), tmp_path / "f.exr"
    layer = {f"left.{name}": np.ones((8, 16), np.float32) for name in "RGBA"}
    foreign(path, dict(layer))
    with pytest.raises(
        PictureFileError, match=r"channels left\.A, left\.B, left\.G, left\.R, not R, G and B .* do: save"
    ):
        read_exr_rgb(path)
    foreign(path, {**{name: np.full((8, 16), 2, np.float32) for name in "RGB"}, **layer})
    assert np.array_equal(read_exr_rgb(path)[0], rgb)


@pytest.mark.parametrize(("level", "white"), [(3e38, None), (1e-40, None), (40.0, 3e38), (1e-20, 1e-20)])
def test_light_that_cannot_be_worked_with_is_refused(tmp_path: Path, level: float, white: float | None) -> None:
    path = tmp_path / "far.exr"
    foreign(
        path, {"RGB": np.full((8, 16, 3), level, np.float32)}, **({} if white is None else {"whiteLuminance": white})
    )
    with pytest.raises(PictureFileError, match=r"far\.exr: its brightest value"):
        read_exr_rgb(path)
    foreign(path, {"RGB": np.zeros((8, 16, 3), np.float32)})
    assert read_exr_rgb(path)[0].max() == 0


def test_no_file_another_file_and_a_folder(tmp_path: Path) -> None:
    (tmp_path / "empty.exr").touch()
    (tmp_path / "text.exr").write_text("v/1 it is not")
    for name in ("none.exr", "empty.exr", "text.exr", "."):
        with pytest.raises(PictureFileError):
            read_exr(tmp_path / name)


def test_damage_is_not_reported_on_standard_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Commands write their JSON there."""
    path = tmp_path / "picture.exr"
    write_exr(path, noise(24, 48))
    data = bytearray(path.read_bytes())
    data[-200:-100] = bytes(100)
    path.write_bytes(data)
    with pytest.raises(PictureFileError, match="cannot be decoded"):
        read_exr(path)
    assert capsys.readouterr().out == ""


def test_every_cut_is_found(tmp_path: Path) -> None:
    path = tmp_path / "picture.exr"
    write_exr(path, noise(24, 48))
    data = path.read_bytes()
    for end in sorted({*range(0, len(data), max(1, len(data) // 60)), len(data) - 1}):
        path.write_bytes(data[:end])
        with pytest.raises(PictureFileError):
            read_exr(path)


def test_flipped_bits_are_found_or_change_nothing(tmp_path: Path) -> None:
    """Bits that no reader uses (the library's own defaults in the header) may flip unseen; the picture stays."""
    path, image = tmp_path / "picture.exr", noise(24, 48)
    write_exr(path, image)
    data = path.read_bytes()
    rng = np.random.default_rng(900_004)
    found = 0
    places = rng.integers(0, 8 * len(data), 150)
    for place in places:
        bad = bytearray(data)
        bad[place // 8] ^= 1 << (place % 8)
        path.write_bytes(bad)
        try:
            assert_same(read_exr(path), image)
        except PictureFileError:
            found += 1
    assert found >= 0.97 * places.size


def test_header_that_promises_too_much(tmp_path: Path) -> None:
    path = tmp_path / "picture.exr"
    write_exr(path, noise(24, 48))
    data = path.read_bytes()
    old = struct.pack("<4i", 0, 0, 47, 23)
    for width, height in ((60_000, 4_000), (2**30, 1), (48, 2**20), (0, 24), (-5, 24), (48, 25)):
        path.write_bytes(data.replace(old, struct.pack("<4i", 0, 0, width - 1, height - 1)))
        with pytest.raises(PictureFileError):
            read_exr(path)


class FailingCalls(durable.OsCalls):
    def fsync(self, fd: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_library_that_says_only_in_words_that_the_disk_is_full(tmp_path: Path) -> None:
    def no_space(part: Path) -> None:
        raise RuntimeError(f'Failed to write pixel data to image file "{part}". {os.strerror(errno.ENOSPC)}.')

    with pytest.raises(DiskFullError) as caught:
        write_whole(tmp_path / "picture.exr", no_space)
    assert "failed: No space left on device" in caught.value.message


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "picture.exr"
    write_exr(path, noise())
    old = path.read_bytes()
    monkeypatch.setattr(durable, "os_calls", FailingCalls())
    with pytest.raises(DiskFullError):
        write_exr(path, luminance_image(np.ones((8, 16, 3))))
    assert path.read_bytes() == old
    assert [p.name for p in tmp_path.iterdir()] == ["picture.exr"]
    with pytest.raises(DiskError):
        write_exr(tmp_path / "no-such-folder" / "picture.exr", noise())


@pytest.mark.skipif(os.name != "posix", reason="names are bytes on POSIX alone")
def test_a_folder_whose_name_is_not_utf8_is_called_that(tmp_path: Path) -> None:
    """The library refused such a path with a ValueError of its own: an internal error."""
    folder = tmp_path / os.fsdecode(b"r\xe4ume")
    folder.mkdir()
    image = luminance_image(np.ones((4, 8, 3), np.float32), Equirectangular(8, 4))
    with pytest.raises(PictureFileError, match="not UTF-8"):
        write_exr(folder / "a.exr", image)
    assert not list(folder.iterdir())
    write_exr(tmp_path / "a.exr", image)
    (tmp_path / "a.exr").rename(folder / "a.exr")
    with pytest.raises(PictureFileError, match="not UTF-8"):
        read_exr(folder / "a.exr")
