"""The outdoor half of the stage calibrate: directions, what k2 holds for, what is said of light not known."""

import weakref
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from pydantic import ValidationError

from mocks.worlds.sky import SimpleSky
from processing.calibration.optics import corrections_unlike, find_optics, glare_taken_off, stated_circle
from processing.calibration.outdoor import outdoor
from processing.calibration.outdoor.session_sky import calibrate_outdoor
from processing.calibration.outdoor.sun_disc import find_sun
from processing.calibration.profile import CameraProfile, CameraState, K2Record, RigProfile
from processing.calibration.profile_records import LensRecord, NdRecord, ResponseRecord, VignettingRecord
from processing.calibration.scale.luminance import ScaleFactor
from processing.calibration.scale.photometry import illuminance_lx
from processing.calibration.scale.vignetting import COPY_SIGMA
from processing.errors import ScaleError
from processing.figures.certificate import certificate
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import modes_of, relative_error
from processing.pipeline import STAGES
from processing.running.fingerprint import visible_part
from processing.sphere import Equirectangular, Fisheye, LensMapping
from processing.stages.calibrate import calibrate_indoor, run
from processing.stages.contract import StageContext
from processing.stages.parameters import CalibrateParameters
from station.session.session import DeviceRecord, FrameRecord, Side
from tests.processing.calibration.outdoor.sky_pictures import optics_of, sky_picture
from tests.station.session.sessions import manifest

WIDTH = 240
NOW = datetime(2026, 6, 1, tzinfo=UTC)
K1 = ScaleFactor(1.0, 0.01)
OPTICS = optics_of(WIDTH)


def k2(**changes) -> K2Record:
    given = {
        "value": 2.0,
        "relative_uncertainty": 0.01,
        "measured_utc": NOW,
        "indoor": CameraState(),
        "n_patches": 6,
        "outdoor": CameraState(),
        "white_ratio": 2.0,
        "residual_stops": 0.0,
    }
    return K2Record(**(given | changes))


def profile(f_number: float | None = None, record: K2Record | None = None) -> RigProfile:
    falloff = VignettingRecord.of(replace(OPTICS.vignetting, f_number=f_number))
    outdoor = CameraProfile(
        side=Side.OUTDOOR, state=CameraState(), created_utc=NOW, vignetting=falloff, lens=LensRecord.of(OPTICS.lens)
    )
    return RigProfile(created_utc=NOW, cameras={Side.OUTDOOR: outdoor}, k2=record)


def calibrated(picture, session=None, rig=None, responses=None, **asked):
    return calibrate_outdoor(
        picture, session or manifest(), CalibrateParameters(**asked), rig or profile(), K1, responses
    )


@pytest.fixture(scope="module")
def picture() -> RelativeImage:
    return sky_picture(SimpleSky(), WIDTH)


@pytest.fixture(scope="module")
def in_units(picture):
    """The picture with k2 given as 1, and nothing else known."""
    return calibrated(picture, k2=1.0)


@pytest.mark.parametrize("view", ["equidistant", "hemispherical", "equirectangular"])
def test_the_sun_stands_where_it_is_in_the_world_of_the_panorama(picture, view):
    session = manifest(heading_rad=np.radians(30.0))
    out = calibrated(picture, session, k2=1.0, outdoor_top_deg=70.0, outdoor_view=view)
    # 70 degrees of compass are 40 from the panorama's middle.
    expected = SimpleSky().sun_azimuth_rad + np.radians(40.0)
    assert find_sun(out.image).azimuth_rad == pytest.approx(expected, abs=0.01)
    assert not any("heading" in text for text in out.warnings)


@pytest.mark.parametrize("least_px", [20, 1000])
def test_a_drafts_sky_is_smaller_and_keeps_its_light_and_its_north(monkeypatch, picture, in_units, least_px):
    monkeypatch.setattr(outdoor, "LEAST_DRAFT_PX", least_px)
    asked = CalibrateParameters(k2=1.0)
    small = calibrate_outdoor(picture, manifest(), asked, profile(), K1, draft=True)
    assert small.image.rgb.shape[1] * (2 if least_px == 20 else 1) == pytest.approx(in_units.image.rgb.shape[1], abs=4)
    assert small.facts["north"] == in_units.facts["north"]
    assert small.facts["sun"] == in_units.facts["sun"]
    whole, part = (one.facts["illuminance_lx"]["up"] for one in (in_units, small))
    assert part["value"] == pytest.approx(whole["value"], rel=0.01)
    assert find_sun(small.image).azimuth_rad == pytest.approx(find_sun(in_units.image).azimuth_rad, abs=0.02)


def test_the_merged_picture_is_let_go_before_the_sky_is_turned(monkeypatch, picture):
    """Of a full-size sky that is 0.4 GB less at the stage's peak."""
    given, real, gone = [replace(picture, rgb=picture.rgb.copy())], outdoor.project, []
    merged = weakref.ref(given[0].rgb)
    monkeypatch.setattr(outdoor, "project", lambda *args: (gone.append(merged() is None), real(*args))[1])
    calibrate_outdoor(given.pop(), manifest(), CalibrateParameters(k2=1.0), profile(), K1)
    assert gone == [True]


def test_north_without_the_panoramas_heading_is_reported(picture):
    assert any("heading is not recorded" in text for text in calibrated(picture, k2=1.0, outdoor_top_deg=70.0).warnings)


def test_a_heading_instead_of_a_sun_is_reported_only_where_there_is_a_sun(picture):
    session, result = manifest(heading_rad=0.5), "north is the panorama's heading"
    assert any(text.startswith(result) for text in calibrated(picture, session, k2=1.0).warnings)
    cloudy = sky_picture(SimpleSky(sun_luminance_cd_m2=0.0), WIDTH)
    overcast = calibrated(cloudy, session, k2=1.0)
    assert overcast.facts["north"]["top_azimuth_deg"] == pytest.approx(np.degrees(0.5))
    assert not any(text.startswith("north") for text in overcast.warnings)
    lost = calibrated(cloudy, manifest(), k2=1.0)
    assert any("the sun was not found" in text for text in lost.warnings)


def test_a_filter_that_no_rig_has_measured_is_found_by_the_skys_colours(picture, in_units):
    assert in_units.facts["nd_colour"].startswith("the sky's own colours")
    row, column = (side // 2 for side in in_units.image.validity.shape)
    seen, shown = picture.rgb[80, 120], in_units.image.rgb[row, column]
    # The zenith is blue again, as behind this filter it is not.
    assert seen[2] < seen[1] < shown[2]
    made = calibrated(picture, rig=profile(record=k2()))
    assert made.facts["nd_colour"] == "no filter recorded"


def test_what_is_bluer_than_the_light_of_the_scale_is_less_sure(picture):
    under = {light: calibrated(picture, rig=profile(record=k2(light=light))).image for light in (0.0, -1.5)}
    for light, image in under.items():
        [mode] = [mode for mode in modes_of(image) if mode.name == "spectra"]
        assert mode.places == (light,)
    assert np.median(under[-1.5].uncertainty) > np.median(under[0.0].uncertainty)


def test_corrections_must_be_those_of_k2():
    made, none = OPTICS.vignetting, None
    assert corrections_unlike(k2(corrections=("panorama",)), {"panorama": made, "vignetting": none}) == []
    without = corrections_unlike(k2(), {"panorama": made})
    assert len(without) == 1
    assert "without correction of the panorama's vignetting" in without[0]
    left_away = corrections_unlike(k2(corrections=("vignetting",)), {"vignetting": none})
    assert len(left_away) == 1
    assert "with correction of the outdoor lens's vignetting" in left_away[0]


def test_another_curve_than_that_of_k2_is_reported(picture):
    row = tuple(np.linspace(-8, 0, 256))
    curve = ResponseRecord(log2_exposure=(row,) * 3, sigma_log2=((0.0,) * 256,) * 3, low=(1,) * 3, high=(254,) * 3)
    same, other = (profile(record=k2(responses={Side.OUTDOOR: digest})) for digest in (curve.digest(), "0" * 64))
    responses = {Side.OUTDOOR: curve}
    assert not any("another response curve" in t for t in calibrated(picture, None, same, responses).warnings)
    assert any("another response curve" in t for t in calibrated(picture, None, other, responses).warnings)


def test_a_lux_reading_scales_a_whole_sky_but_not_one_with_a_clipped_sun(picture):
    assert calibrated(picture, outdoor_lux=50_000.0).facts["illuminance_lx"]["up"]["value"] == pytest.approx(5e4)
    cut = sky_picture(SimpleSky(), WIDTH, clip=1e5)
    with pytest.raises(ScaleError, match="sun is clipped"):
        calibrated(cut, outdoor_lux=50_000.0)
    assert any("clipped in the shortest stop" in text for text in calibrated(cut, k2=1.0).warnings)


def test_the_illuminance_of_a_sky_scaled_by_a_lux_meter_is_as_sure_as_the_meter(picture):
    """Noise, curve and stray light of the sky move light about in it: their sum is the reading, and k1 cancels."""
    noisy = replace(picture, uncertainty=np.where(picture.uncertainty < 1, 0.3, picture.uncertainty).astype(np.float32))
    out = calibrated(noisy, outdoor_lux=50_000.0)
    facts = {"indoor": {"k1_parts": {"meter": 0.012, "spot": 0.005, "picture": 0.006}}, "outdoor": out.facts}
    [budget] = certificate({"outdoor": out.image}, facts, {})["budgets"]
    assert budget["expanded"] == pytest.approx(2 * 0.05 * 50_000, rel=1e-3)
    assert {row["cause"] for row in budget["rows"] if row["relative_uncertainty"] > 1e-3} == {"lux meter"}
    assert not {"meter", "spot", "picture", "k2"} & {row["cause"] for row in budget["rows"]}
    assert out.facts["illuminance_lx"]["up"]["uncertainty"] == pytest.approx(2500)
    # What faces the horizon is not the reading: there the sky's own doubt counts, and the scale's noise with it.
    assert illuminance_lx(out.image, (0, 1, 0)).uncertainty_lx > 0.06 * illuminance_lx(out.image, (0, 1, 0)).value_lx
    brighter = replace(out.image, rgb=out.image.rgb * np.float32(1.01))
    assert illuminance_lx(brighter).uncertainty_lx > 1.05 * 2500


def test_clipped_light_makes_a_lower_bound_and_is_reported(in_units):
    out = calibrated(sky_picture(SimpleSky(), WIDTH, clip=3e3), k2=1.0)
    assert out.facts["illuminance_lx"]["up"]["clipped_share"] > 0.01
    assert any("lower bound because part comes from pixels clipped" in text for text in out.warnings)
    assert not any("lower bound" in text for text in in_units.warnings)


@pytest.mark.parametrize("name", ["k1", "k2", "outdoor_lux"])
def test_a_factor_that_no_picture_holds_is_refused(name: str) -> None:
    """With k1 = 1e-308 every pixel was 0 cd/m2, and valid."""
    with pytest.raises(ValidationError):
        CalibrateParameters(**{name: 1e-308})


def test_factors_that_were_given_have_no_known_uncertainty(in_units):
    assert any(text.startswith("k2 was given") for text in in_units.warnings)
    result = calibrate_indoor(even_panorama(), manifest(), CalibrateParameters(k1=2.0), None).warnings
    assert any(text.startswith("k1 was given") for text in result)


def even_panorama() -> RelativeImage:
    ones = np.ones((32, 64), np.float32)
    return RelativeImage(
        np.ones((32, 64, 3), np.float32), 0.01 * ones, np.zeros((32, 64), np.uint8), Equirectangular(64, 32)
    )


def drifting(side: Side, ratio: float | None, **fields):
    """A session whose bracket of a side was followed by one of its stops again."""
    repeat = {"side": side, "stop": 0, "taken_utc": NOW, "after_s": 60.0, "ratio": ratio, "patches": 50}
    return manifest(references=(repeat,), **fields)


def frame_record(side: Side, taken_utc) -> FrameRecord:
    """The first frame of a bracket."""
    shot = {"asked_s": 1.0, "camera_s": 1.0, "taken_utc": taken_utc, "size_bytes": 1, "sha256": "0" * 64}
    return FrameRecord(side=side, stop=0, file=f"{side}/0.jpg", **shot)


def budget_of(image, facts, side):
    rows = certificate({side: image}, facts, {})["budgets"][0]["rows"]
    return {row["cause"]: row["relative_uncertainty"] for row in rows}


def test_light_that_drifted_until_a_stop_was_repeated_is_in_scale_and_certificate(picture):
    """A rectangle of the drift's width; where the meter's two readings show more, theirs counts."""
    reading = {
        "when": "before",
        "luminance_cd_m2": 10.0,
        "taken_utc": NOW,
        "status": "typed",
        "raw": "10.00",
        "n_samples": 1,
    }
    target = {"longitude_rad": 0.0, "latitude_rad": 0.0}
    room = {"readings": (reading,), "target": target}
    for ratio, drift in ((0.9, 0.1 / 12**0.5), (None, 0.0)):
        session = drifting(Side.INDOOR, ratio, **room)
        inside = calibrate_indoor(even_panorama(), session, CalibrateParameters(), None)
        assert inside.facts["k1_parts"]["drift"] == pytest.approx(drift)
        assert budget_of(inside.image, {"indoor": inside.facts}, "indoor")["drift"] == pytest.approx(drift)
    [stage] = [stage for stage in STAGES if stage.name == "calibrate"]
    assert visible_part(drifting(Side.INDOOR, 0.9), stage.reads).repeat_drift(Side.INDOOR) == pytest.approx(0.1)
    first = frame_record(Side.INDOOR, NOW - timedelta(seconds=120))
    assert drifting(Side.INDOOR, 0.9, frames=(first,)).repeat_drift(Side.INDOOR) == pytest.approx(0.2)
    later = reading | {"when": "after", "luminance_cd_m2": 12.0, "taken_utc": NOW + timedelta(minutes=2)}
    session = drifting(Side.INDOOR, 0.99, **(room | {"readings": (reading, later)}))
    inside = calibrate_indoor(even_panorama(), session, CalibrateParameters(), None)
    assert inside.facts["k1_parts"]["drift"] == pytest.approx(0.2 / 12**0.5)

    facts = {"indoor": {"k1_parts": {"meter": 0.01, "drift": 0.0}}}
    still = calibrated(picture, rig=profile(record=k2()))
    moved = calibrated(picture, drifting(Side.OUTDOOR, 1.12), profile(record=k2()))
    assert moved.image.scale_uncertainty == pytest.approx(np.hypot(still.image.scale_uncertainty, 0.12 / 12**0.5))
    rows = budget_of(moved.image, facts | {"outdoor": moved.facts}, "outdoor")
    assert rows["drift"] == pytest.approx(0.12 / 12**0.5)
    assert "scale, other" not in rows
    found = certificate({"outdoor": moved.image}, facts | {"outdoor": moved.facts}, {})["indices"]
    assert next(row["value"] for row in found if row["index"] == "outdoor: stability") == pytest.approx(0.12)


def test_a_published_fall_off_is_in_the_rooms_budget_and_none_on_its_lenses_axes():
    device = {"role": "indoor", "kind": "theta_z1", "model": "RICOH THETA Z1"}
    found = calibrate_indoor(even_panorama(), manifest(devices=(device,)), CalibrateParameters(k1=1.0), None)
    rows = budget_of(found.image, {"indoor": found.facts}, "indoor")
    # A level plane sees the stitch, overhead, at 90 degrees from the axes.
    assert 0.5 * COPY_SIGMA < rows["fall-off"] < COPY_SIGMA
    bare = calibrate_indoor(
        even_panorama(), manifest(devices=(device,)), CalibrateParameters(k1=1.0, falloff="off"), None
    )
    (copy,) = (mode for mode in modes_of(found.image) if mode.name == "fall-off")
    off = np.abs(relative_error(copy, found.image, luminance_cd_m2(found.image.rgb)))
    assert off[0].mean() == pytest.approx(COPY_SIGMA, rel=0.05)
    assert off[16, 32] < 0.3 * COPY_SIGMA
    more = np.sqrt(found.image.uncertainty**2 - bare.image.uncertainty**2)  # stray light follows the picture a little
    assert more[0].mean() == pytest.approx(COPY_SIGMA, rel=0.15)
    assert "fall-off" not in budget_of(bare.image, {"indoor": bare.facts}, "indoor")


def test_a_profiles_fall_off_of_another_aperture_is_reported_and_doubted(picture):
    frame = FrameRecord(
        side=Side.OUTDOOR,
        stop=0,
        file="outdoor/00.jpg",
        size_bytes=1,
        sha256="0" * 64,
        asked_s=1.0,
        camera_s=1.0,
        f_number=16.0,
    )
    session = manifest(frames=(frame,))
    asked = CalibrateParameters()
    optics, _, result = find_optics(picture, session, asked, profile(8.0), None)
    assert optics.vignetting.relative_uncertainty >= 0.03
    assert any("f/8 was used" in text for text in result)
    optics, _, result = find_optics(picture, session, asked, profile(16.0), None)
    assert optics.vignetting.relative_uncertainty == 0
    assert not any("was used" in text for text in result)


def test_a_mapping_that_nobody_measured_is_said_to_be_assumed(picture):
    """A profile's lens is no other: calibration finds its circle, and takes its mapping from the kind of camera."""
    asked = CalibrateParameters()
    canon, other = (
        manifest(devices=(DeviceRecord(role="outdoor", kind=kind, model="A"),)) for kind in ("canon_5d2", "imported")
    )
    for rig in (profile(), None):
        for one, assumed in ((canon, False), (other, True)):
            said = find_optics(picture, one, asked, rig, None)[2]
            assert any("mapping" in text and "assumed" in text for text in said) == assumed


def test_a_tint_that_the_rigs_chart_left_uncertain_is_warned_of_in_every_session() -> None:
    picture, known = sky_picture(SimpleSky(), WIDTH), profile(16.0)
    camera = known.cameras[Side.OUTDOOR]
    for colour, warned in ((0.01, False), (0.2, True)):
        tint = NdRecord.of(replace(OPTICS.filter, colour_uncertainty=colour))
        rig = known.model_copy(update={"cameras": {Side.OUTDOOR: camera.model_copy(update={"nd": tint})}})
        optics, _, result = find_optics(picture, manifest(), CalibrateParameters(), rig, None)
        assert optics.filter == replace(OPTICS.filter, colour_uncertainty=colour)
        assert any("20% in colour" in text for text in result) == warned


def unveiled(picture, rgb):
    """The picture with this light, the same without its veil, and what was found of it."""
    even, none = np.full(rgb.shape[:2], 0.01, np.float32), np.zeros(rgb.shape[:2], np.uint8)
    veiled = replace(picture, rgb=rgb, uncertainty=even, validity=none)
    clean, kernel, found = glare_taken_off(veiled, OPTICS.lens.fisheye((rgb.shape[1], rgb.shape[0])))
    assert kernel is not None
    assert found["taken_off"]
    return veiled, clean, found


def test_the_veil_taken_off_leaves_the_light_of_the_field(picture):
    flat = np.where(luminance_cd_m2(picture.rgb)[..., None] > 0, np.float32(1000), np.float32(0))
    inside = flat[..., 0] > 0
    lost = np.float32(0.02)
    rgb = (1 - lost) * flat + lost * 1000 * np.ones(3, np.float32)
    _, clean, found = unveiled(picture, rgb)
    assert found["index"] == pytest.approx(0.02, rel=0.02)
    assert float(np.median(clean.rgb[inside])) == pytest.approx(1000, rel=1e-3)


def test_the_veil_taken_off_leaves_its_doubt(picture):
    height, width = picture.rgb.shape[:2]
    rgb = picture.rgb + np.float32(10.0)
    rgb[height // 2, width // 2] = 1.0
    rgb += np.random.default_rng(1).normal(0, 1, rgb.shape).astype(np.float32)
    veiled, clean, _ = unveiled(picture, rgb)
    dark = (clean.rgb.sum(axis=-1) == 0) & (veiled.rgb.sum(axis=-1) > 0)
    assert dark.any()
    assert (clean.validity[dark] == Validity.DARK).all()
    lit = clean.rgb.min(axis=-1) > 0
    assert (clean.uncertainty[lit] >= veiled.uncertainty[lit]).all()


@pytest.mark.parametrize("stated", ["abc", [0.5, 0.5], [0.5, 0.5, -1.0], [0.5, "x", 0.3]])
def test_a_circle_that_a_rig_file_states_wrongly_is_none(stated):
    assert stated_circle({"outdoor": {"image_circle": stated}}) is None
    assert stated_circle({"outdoor": stated}) is None
    assert stated_circle({"outdoor": {"image_circle": [0.5, 0.4, 0.3]}}) == (0.5, 0.4, 0.3)


@pytest.mark.parametrize(("as_fisheye", "why"), [(True, "circle"), (False, "stops brighter")])
def test_a_sky_whose_lens_cannot_be_determined_is_left_out_and_the_room_stands(tmp_path, as_fisheye, why):
    sky = even_panorama()
    sky = replace(sky, geometry=Fisheye(64, 32, LensMapping.EQUIDISTANT, 16.0)) if as_fisheye else sky
    made = {"indoor": even_panorama(), "outdoor": sky, "response": {}}
    asked = CalibrateParameters(k1=2.0, k2=1.0)
    context = StageContext(manifest(), tmp_path, tmp_path, asked, lambda _stage, name: made[name], lambda _: {})
    found = run(context)
    assert set(found.artifacts) == {"indoor", "calibration"}
    assert why in found.left_out["outdoor"]
    assert any("no outdoor picture" in warning.message for warning in found.warnings)
