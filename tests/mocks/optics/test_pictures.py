"""Pictures as files: JPEG with EXIF, raw files, the cache, and worker processes."""

import io
import itertools
import os
import threading
import time
from dataclasses import replace
from datetime import datetime
from fractions import Fraction

import numpy as np
import pytest
from PIL import ExifTags, Image

from mocks.instruments import bench as bench_module
from mocks.instruments.bench import BenchOptions, WantedCamera, make_bench
from mocks.instruments.exposures import ShotRequest
from mocks.optics import pictures as pictures_module
from mocks.optics.camera import CANON_5D2, THETA_Z1
from mocks.optics.picture_cache import PictureCache, PictureCacheError, content_key, default_folder
from mocks.optics.picture_jobs import is_whole_jpeg
from mocks.optics.pictures import RenderedShots
from mocks.optics.sensor import Exposure
from mocks.worlds.light import LightDrift, UniformWorld, mean_weights

SIZES = {"theta_z1": (160, 80), "canon_5d2": (168, 112)}


def request_for(optics, shutter_s=1 / 60, **changes):
    theta = optics.name == "theta_z1"
    width, height = SIZES[optics.name]
    asked = ShotRequest(
        shutter_s=shutter_s,
        iso=100 if theta else 200,
        f_number=5.6 if theta else 16.0,
        color_temperature_k=6500,
        width_px=width,
        height_px=height,
        taken_local=datetime(2023, 5, 19, 15, 54, 7, 250000),
        sequence=17,
        manufacturer="RICOH" if theta else "Canon",
        model="RICOH THETA Z1" if theta else "Canon EOS 5D Mark II",
        serial="YN10012345" if theta else "0330112233",
        firmware="2.20.1",
    )
    return replace(asked, **changes)


@pytest.fixture
def cache(tmp_path):
    return PictureCache(tmp_path / "cache")


def decoded(data):
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"))


@pytest.mark.parametrize("optics", [THETA_Z1, CANON_5D2])
def test_exif_says_what_the_camera_was_set_to(cache, optics):
    request = request_for(optics)
    picture = Image.open(io.BytesIO(RenderedShots(UniformWorld(), optics, cache=cache).jpeg(request)))
    assert picture.size == SIZES[optics.name]
    assert (picture.format, picture.mode) == ("JPEG", "RGB")
    exif, base = picture.getexif(), ExifTags.Base
    assert (exif[base.Make], exif[base.Model]) == (request.manufacturer, request.model)
    assert exif[base.Software] == "2.20.1"
    detail = exif.get_ifd(ExifTags.IFD.Exif)
    assert Fraction(detail[base.ExposureTime]) == Fraction(1, 60)
    assert float(detail[base.FNumber]) == request.f_number
    assert detail[base.ISOSpeedRatings] == request.iso
    assert detail[base.DateTimeOriginal] == "2023:05:19 15:54:07"
    assert detail[base.SubsecTimeOriginal] == "25"
    assert (detail[base.ExifImageWidth], detail[base.ExifImageHeight]) == picture.size
    assert detail[base.WhiteBalance] == 1
    assert detail[base.BodySerialNumber] == request.serial
    assert detail[0x9211] == 17
    assert float(detail[base.FocalLength]) == (2.6 if optics is THETA_Z1 else 8.0)


@pytest.mark.parametrize(
    ("shutter_s", "written"),
    [(4, (4, 1)), (1, (1, 1)), (0.25, (1, 4)), (1 / 8000, (1, 8000)), (13, (13, 1)), (3.2, (16, 5)), (0.4, (2, 5))],
)
def test_exposure_times_are_written_as_cameras_write_them(cache, shutter_s, written):
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    detail = Image.open(io.BytesIO(shots.jpeg(request_for(THETA_Z1, shutter_s)))).getexif().get_ifd(0x8769)
    assert Fraction(detail[ExifTags.Base.ExposureTime]) == Fraction(*written)


def test_panorama_says_that_it_is_one_and_the_fisheye_does_not(cache):
    theta = RenderedShots(UniformWorld(), THETA_Z1, cache=cache).jpeg(request_for(THETA_Z1))
    xmp = Image.open(io.BytesIO(theta)).info["xmp"].decode()
    assert 'GPano:ProjectionType="equirectangular"' in xmp
    assert 'GPano:FullPanoWidthPixels="160"' in xmp
    canon = RenderedShots(UniformWorld(), CANON_5D2, cache=cache).jpeg(request_for(CANON_5D2))
    assert "xmp" not in Image.open(io.BytesIO(canon)).info


def test_jpeg_is_422_and_starts_with_exif(cache):
    data = RenderedShots(UniformWorld(), CANON_5D2, cache=cache).jpeg(request_for(CANON_5D2))
    assert data[:4] == b"\xff\xd8\xff\xe1"
    assert data[6:12] == b"Exif\0\0"
    assert data.count(b"JFIF") == 0
    assert [layer[1:3] for layer in Image.open(io.BytesIO(data)).layer] == [(2, 1), (1, 1), (1, 1)]


def test_the_same_frame_at_another_time_differs_in_exif_only(cache):
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    one = shots.jpeg(request_for(THETA_Z1))
    later = shots.jpeg(request_for(THETA_Z1, sequence=18, taken_local=datetime(2023, 5, 19, 15, 55)))
    assert one != later
    np.testing.assert_array_equal(decoded(one), decoded(later))


def test_brackets_darken_and_saturate(cache):
    shots = RenderedShots(UniformWorld(30.0), THETA_Z1, cache=cache)
    stops = [4, 1, 1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000, 1 / 4000, 1 / 8000]
    means = [decoded(shots.jpeg(request_for(THETA_Z1, stop))).mean() for stop in stops]
    assert means[0] == pytest.approx(255, abs=1)
    assert means[-1] < 3
    assert all(a >= b for a, b in itertools.pairwise(means))


def test_prepared_pictures_are_served_without_rendering(cache, monkeypatch):
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    assert shots.prepare([1 / 60, 1 / 250], 160, 80) == 2
    assert shots.prepare([1 / 60, 1 / 250], 160, 80) == 0

    def fail(job):
        raise AssertionError("rendered at the moment of exposure")

    monkeypatch.setattr(pictures_module.picture_jobs, "expose", fail)
    assert is_whole_jpeg(shots.jpeg(request_for(THETA_Z1, 1 / 60)))
    assert is_whole_jpeg(shots.jpeg(request_for(THETA_Z1, 0.0166667)))
    with pytest.raises(AssertionError):
        shots.jpeg(request_for(THETA_Z1, 1))


def test_cache_is_keyed_by_world_optics_settings_and_seed(cache):
    def picture(world=100.0, optics=THETA_Z1, seed=0, **changes):
        return RenderedShots(UniformWorld(world), optics, seed=seed, cache=cache).jpeg(request_for(THETA_Z1, **changes))

    base = decoded(picture())
    np.testing.assert_array_equal(base, decoded(picture()))
    variants = [
        picture(world=120.0),
        picture(optics=replace(THETA_Z1, glare=0.05)),
        picture(optics=replace(THETA_Z1, sensor=replace(THETA_Z1.sensor, saturation_constant=90.0))),
        picture(seed=1),
        picture(iso=200),
        picture(f_number=3.5),
        picture(color_temperature_k=5000),
        picture(shutter_s=1 / 50),
    ]
    for variant in variants:
        assert not np.array_equal(base, decoded(variant))


def test_noise_differs_from_stop_to_stop(cache):
    """Two stops of equal exposure (time x speed) have the same mean and other noise."""
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    one = decoded(shots.jpeg(request_for(THETA_Z1, 1 / 64))).astype(int)
    two = decoded(shots.jpeg(request_for(THETA_Z1, 1 / 60))).astype(int)
    assert one.mean() == pytest.approx(two.mean(), abs=0.3)
    assert (one != two).mean() > 0.2


def test_drifting_light_shows_in_the_frames_of_its_time(cache):
    world = UniformWorld(30.0, drift=LightDrift(amplitude=0.3, seed=2))
    shots = RenderedShots(world, THETA_Z1, cache=cache)
    shots.prepare([1 / 60], 160, 80, times_s=[0.0])
    start = decoded(shots.jpeg(request_for(THETA_Z1))).mean()
    t_s = min(range(0, 240, 10), key=world.drift.factor)
    assert world.drift.factor(t_s) < 0.8
    shots.prepare([1 / 60], 160, 80, times_s=[float(t_s)])
    assert decoded(shots.jpeg(request_for(THETA_Z1))).mean() < start - 2


class CloudyWorld(UniformWorld):
    """Constant grey sky above, and a sun's light below that goes from 1 to 0 between 10 and 20 s."""

    @property
    def components(self):
        return ("sky", "sun")

    def weights(self, t_s):
        return (1.0, float(np.clip((20 - t_s) / 10, 0, 1)))

    def radiance(self, site, directions, pixel_rad=0.0, component=None):
        above = directions[..., 2] > 0
        seen = {None: np.ones_like(above), 0: above, 1: ~above}[component]
        return np.repeat(seen[..., None], 3, axis=-1).astype(np.float32) * np.float32(self.luminance_cd_m2)


def test_a_cloud_dims_the_sun_and_not_the_sky(cache):
    """The frame of each stop shows the light of its own time, in proportions that change."""
    shots = RenderedShots(CloudyWorld(), replace(THETA_Z1, glare=0.0), cache=cache)
    assert shots.prepare([1 / 60, 1 / 64, 1 / 50], 160, 80, times_s=[0.0, 15.0, 30.0]) == 3
    before, under, after = (decoded(shots.jpeg(request_for(THETA_Z1, stop))) for stop in (1 / 60, 1 / 64, 1 / 50))
    assert before[:36].mean() == pytest.approx(before[44:].mean(), abs=1)
    assert under[:36].mean() == pytest.approx(before[:36].mean(), abs=1)
    decode = THETA_Z1.sensor.tone[1].decode
    dimmed = decode(under[44:, :, 1] / 255).mean() / decode(before[44:, :, 1] / 255).mean()
    assert dimmed == pytest.approx(0.5, abs=0.03)
    assert after[44:].mean() < 3
    assert len(list(cache.folder.glob("*.image"))) == 1


def test_long_exposures_see_the_mean_of_their_light(cache):
    """Four seconds from 12 s on: the sun goes from 0.8 to 0.4 meanwhile."""
    world = CloudyWorld()
    assert mean_weights(world, 12.0, 4.0) == pytest.approx((1.0, 0.6))
    assert mean_weights(world, 18.0, 4.0) == pytest.approx((1.0, 0.05), abs=0.005)
    assert mean_weights(world, 0.0, 1 / 60) == (1.0, 1.0)


def test_the_bench_passes_the_planned_times_on(monkeypatch, tmp_path):
    """At 1/60 s, planned for 16 s, the sun is at 0.4; without a plan it shines."""
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    monkeypatch.setattr(bench_module, "open_world", lambda name: CloudyWorld())
    wanted = [WantedCamera("theta_z1", 100, 5.6, 6500, (160, 80))]
    lower = []
    for options in (BenchOptions(), BenchOptions(times_s={"theta_z1": [30.0, 16.0]})):
        bench = make_bench("clouds", wanted, [1.0, 1 / 60], options)
        picture = decoded(bench.cameras["theta_z1"].darkroom.jpeg(request_for(THETA_Z1), ()))
        lower.append(THETA_Z1.sensor.tone[1].decode(picture[44:, :, 1] / 255).mean())
        bench.close()
    assert lower[1] / lower[0] == pytest.approx(0.4, abs=0.03)


def test_a_cut_off_cached_picture_is_rendered_anew(cache):
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    good = shots.jpeg(request_for(THETA_Z1))
    (stored,) = cache.folder.glob("*.jpg")
    stored.write_bytes(stored.read_bytes()[:500])
    assert shots.jpeg(request_for(THETA_Z1)) == good


def test_raw_files_are_tiffs_of_the_right_kind(cache):
    for optics, suffix in ((THETA_Z1, "dng"), (CANON_5D2, "cr2")):
        full = 1 / optics.sensor.exposure_gain(Exposure(1 / 60, *((100, 5.6) if suffix == "dng" else (200, 16.0))))
        clear = replace(optics, filter=replace(optics.filter, density=0.0))
        data = RenderedShots(UniformWorld(0.5 * full), clear, cache=cache).raw(request_for(optics))
        assert data[:4] == b"II*\0"
        assert (data[8:10] == b"CR") is (suffix == "cr2")
        tags = read_tags(data)
        assert (tags[258], tags[262], tags[259]) == (16, 32803, 1)
        height, width = tags[257], tags[256]
        assert (width, height) == SIZES[optics.name]
        assert tags[273] + tags[279] == len(data)
        mosaic = np.frombuffer(data, "<u2", offset=tags[273]).reshape(height, width)
        middle = width // 4 if suffix == "dng" else width // 2  # a panorama camera's two lenses stand side by side
        centre = mosaic[height // 2 - 10 : height // 2 + 10, middle - 10 : middle + 10]
        assert mosaic.max() < 2**14
        assert optics.sensor.raw_black + 4000 < centre.mean() < 2**14 - 1


def read_tags(data):
    """Tags with one SHORT or LONG, read by hand."""
    start = int.from_bytes(data[4:8], "little")
    tags = {}
    for index in range(int.from_bytes(data[start : start + 2], "little")):
        entry = data[start + 2 + 12 * index :][:12]
        tag, kind = int.from_bytes(entry[:2], "little"), int.from_bytes(entry[2:4], "little")
        if kind in (3, 4):
            tags[tag] = int.from_bytes(entry[8 : 10 if kind == 3 else 12], "little")
    return tags


def test_workers_render_the_same_pixels(tmp_path, monkeypatch):
    """The way through worker processes, forced at a small size."""
    alone = RenderedShots(UniformWorld(), THETA_Z1, cache=PictureCache(tmp_path / "a"), workers=0)
    monkeypatch.setattr(pictures_module, "_POOL_FROM_PX", 1)
    pooled = RenderedShots(UniformWorld(), THETA_Z1, cache=PictureCache(tmp_path / "b"), workers=2)
    assert pooled.prepare([1 / 60, 1 / 250], 160, 80, raw=True) == 2
    for stop in (1 / 60, 1 / 250):
        assert pooled.jpeg(request_for(THETA_Z1, stop)) == alone.jpeg(request_for(THETA_Z1, stop))


def test_progress_counts_to_the_end(cache):
    seen = []
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache, on_progress=lambda *step: seen.append(step))
    shots.prepare([1 / 60, 1 / 250], 160, 80)
    total = seen[-1][1]
    assert seen == [(done, total) for done in range(1, total + 1)]
    assert total == 3


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=PictureCache(tmp_path / "file" / "cache"))
    with pytest.raises(PictureCacheError, match="DAYLIT_CACHE"):
        shots.jpeg(request_for(THETA_Z1))


def test_two_threads_may_ask_at_once(cache):
    shots = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    answers = []
    threads = [threading.Thread(target=lambda: answers.append(shots.jpeg(request_for(THETA_Z1)))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(answers) == 4
    assert len(set(answers)) == 1


# --- the cache itself ---


def age(path, seconds):
    os.utime(path, (time.time() - seconds,) * 2)


def test_cache_forgets_what_was_unused_for_longest(tmp_path):
    cache = PictureCache(tmp_path, limit_bytes=300)
    for index, name in enumerate(("old", "middle", "new")):
        cache.write(name, ".jpg", bytes(100))
        age(cache.path(name, ".jpg"), 1000 - 100 * index)
    assert cache.read("old", ".jpg") == bytes(100)
    cache.limit_bytes = 250
    cache.evict()
    assert sorted(path.name for path in tmp_path.glob("*.jpg")) == ["new.jpg", "old.jpg"]


def test_cache_keeps_what_is_in_use_and_clears_what_was_abandoned(tmp_path):
    cache = PictureCache(tmp_path, limit_bytes=10)
    cache.write("fresh", ".jpg", bytes(100))
    left = tmp_path / "tmp123.part"
    left.write_bytes(b"x")
    cache.evict()
    assert left.exists()
    age(left, 10_000)
    cache.evict()
    assert not left.exists()
    assert cache.holds("fresh", ".jpg")


def test_cache_holds_nothing_half_written(tmp_path):
    cache = PictureCache(tmp_path)

    def interrupted():
        with cache.new_file("a", ".jpg") as path:
            path.write_bytes(b"half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        interrupted()
    assert list(tmp_path.iterdir()) == []
    assert cache.read("a", ".jpg") is None


def test_cache_folder_can_be_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv("DAYLIT_CACHE", str(tmp_path))
    assert default_folder() == tmp_path / "pictures"
    monkeypatch.delenv("DAYLIT_CACHE")
    assert default_folder().parts[-2:] == ("daylit", "pictures")


def test_content_keys_keep_parts_apart():
    assert content_key("ab", "c") != content_key("a", "bc")
    assert content_key(1, 2.0) == content_key(1, 2.0)


def test_an_exposure_taken_again_has_noise_of_its_own_where_that_is_asked_for(cache):
    request = request_for(THETA_Z1)
    usual = RenderedShots(UniformWorld(), THETA_Z1, cache=cache)
    first = usual.jpeg(request)
    assert usual.jpeg(request) == first
    fresh = RenderedShots(UniformWorld(), THETA_Z1, fresh=True, cache=cache)
    shots = [fresh.jpeg(request) for _ in range(3)]
    assert shots[0] == first
    assert len(set(shots)) == 3
    assert decoded(shots[1]).mean() == pytest.approx(decoded(first).mean(), abs=0.5)
