"""The calibration profile: what is written is read, and what cannot be right is named."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.photometry.synthetic_bracket import synthetic_bracket
from processing.calibration.merge.modes import curve_modes, merge_modes
from processing.calibration.merge.tables import merge_tables
from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.calibration.outdoor.nd_filter import NdFilter
from processing.calibration.profile import (
    CameraProfile,
    CameraState,
    K2Record,
    PatchRecord,
    RigProfile,
    camera_state,
    chart_mismatches,
    load_profile,
    profile_matches,
    require_k2,
    save_profile,
    unlike_profile,
)
from processing.calibration.profile_records import (
    LensRecord,
    NdRecord,
    NoiseRecord,
    ResponseRecord,
    ShutterRecord,
    ShutterTime,
    VignettingRecord,
)
from processing.calibration.response.curve import NoiseModel, ResponseCurve
from processing.calibration.response.response import recover_response
from processing.calibration.response.samples import Bracket8
from processing.calibration.response.shutter import ShutterRule
from processing.calibration.scale.chart_patches import PATCH_NAMES, reflectances
from processing.calibration.scale.vignetting import Vignetting
from processing.errors import ProfileError
from processing.pictures.images import luminance_cd_m2
from processing.sphere import LensMapping
from station.session.session import DeviceRecord, SessionManifest, SettingRecord, Side
from tests.station.session.sessions import manifest

NOW = datetime(2026, 6, 1, tzinfo=UTC)
TIMES_S = np.array([1.0, 1 / 4, 1 / 16])
INDOOR = CameraState(kind="theta_z1", model="RICOH THETA Z1", serial="1", f_number=5.6, iso=100)
OUTDOOR = CameraState(
    kind="canon_5d2", serial="2", lens="8 mm", nd_filter="ND 3.0", f_number=16, iso=200, color_temperature_k=6500
)


def curve() -> ResponseCurve:
    rows = np.linspace(-9, 2, 256)[None] + np.array([[0.0], [0.01], [0.02]])
    sigma = np.full((3, 256), 0.003)
    sigma[:, 0] = np.inf
    return ResponseCurve(rows, sigma, (4, 4, 4), (250, 251, 252), n_samples=5000, residual_stops=0.004)


def profile() -> RigProfile:
    circle = ImageCircle((700.0, 468.0), 441.0, (1404, 936), 0.02)
    outdoor = CameraProfile(
        side=Side.OUTDOOR,
        state=OUTDOOR,
        created_utc=NOW,
        response=ResponseRecord.of(curve()),
        noise=NoiseRecord.of(NoiseModel((1e-4, 1e-4, 1e-4), (1e-3, 1e-3, 1e-3))),
        shutter=ShutterRecord(rule=ShutterRule.THIRDS, times=(ShutterTime(nominal_s=1 / 8000, true_s=1.21e-4),)),
        vignetting=VignettingRecord.of(Vignetting((2, 4), (0.1, -0.4), 0.002, 16.0)),
        lens=LensRecord.of(LensModel(LensMapping.EQUISOLID, circle, 1.6, (), "test")),
        nd=NdRecord.of(NdFilter.of_matrix(np.diag((1 / 793, 1 / 811, 1 / 1197)))),
    )
    k2 = K2Record(
        value=2.117,
        relative_uncertainty=0.01,
        measured_utc=NOW,
        indoor=INDOOR,
        outdoor=OUTDOOR,
        white_ratio=2.12,
        n_patches=6,
        residual_stops=0.004,
        corrections=("vignetting", "nd"),
    )
    indoor = CameraProfile(side=Side.INDOOR, state=INDOOR, created_utc=NOW)
    return RigProfile(created_utc=NOW, cameras={Side.INDOOR: indoor, Side.OUTDOOR: outdoor}, k2=k2)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path, made = tmp_path / "calibration.json", profile()
    save_profile(path, made)
    save_profile(path, made)  # an old one is replaced
    found = load_profile(path)
    assert found == made
    assert [p.name for p in tmp_path.iterdir()] == ["calibration.json"]


def test_records_give_back_what_they_were_made_of() -> None:
    made, outdoor = curve(), profile().cameras[Side.OUTDOOR]
    assert outdoor.response is not None
    assert outdoor.lens is not None
    assert outdoor.vignetting is not None
    assert outdoor.nd is not None
    back = outdoor.response.curve()
    np.testing.assert_array_equal(back.log2_exposure, made.log2_exposure)
    np.testing.assert_array_equal(back.sigma_log2[:, 1:], made.sigma_log2[:, 1:])
    assert np.all(back.sigma_log2[:, 0] > 50)  # unknown stays unknown, in a number that JSON has
    assert (back.low, back.high) == (made.low, made.high)
    lens = outdoor.lens.lens()
    np.testing.assert_allclose((*lens.circle.centre_px, lens.circle.radius_px), (700, 468, 441))
    assert outdoor.vignetting.vignetting() == Vignetting((2, 4), (0.1, -0.4), 0.002, 16.0)
    assert outdoor.nd.nd_filter() == NdFilter.of_matrix(np.diag((1 / 793, 1 / 811, 1 / 1197)))


def test_a_profile_keeps_the_curves_modes_and_an_older_one_without_them_is_read(tmp_path: Path) -> None:
    """What the fit left open goes into the merge's shared errors; the three tilts stand in only for older profiles."""
    made = recover_response([Bracket8((taken := synthetic_bracket((160, 240), 5)).frames, taken.true_s)]).curve
    assert made.modes is not None
    data = json.loads(profile().model_dump_json())
    data["cameras"]["outdoor"]["response"] = json.loads(ResponseRecord.of(made).model_dump_json())
    path = tmp_path / "calibration.json"
    found = {}
    for kept in (True, False):
        if not kept:
            for name in ("modes", "held_out", "prior_strength"):
                del data["cameras"]["outdoor"]["response"][name]
        path.write_text(json.dumps(data))
        response = load_profile(path).cameras[Side.OUTDOOR].response
        assert response is not None
        back = response.curve()
        np.testing.assert_allclose(curve_modes(back), made.modes if kept else tilts(back), atol=1e-6)
        found[kept] = shared(back)
    np.testing.assert_allclose(found[True], shared(made), atol=1e-5)
    assert np.abs(found[False] / found[True] - 1).max() > 0.2


def shared(curve: ResponseCurve) -> npt.NDArray[np.float64]:
    """What a merge by a curve leaves uncertain in all pixels, by level."""
    sigma = np.full(3, 1e-9)
    tables = merge_tables(curve, NoiseModel((1e-4,) * 3, (1e-3,) * 3), TIMES_S, sigma, 0.0)
    values = [mode.values for mode in merge_modes(tables, curve, TIMES_S, sigma)]
    return np.asarray(np.sqrt(np.square(values).sum(axis=0)))


def tilts(curve: ResponseCurve) -> npt.NDArray[np.float64]:
    return np.eye(3)[:, :, None] * (np.sign(np.arange(256) - curve.sigma_code) * curve.sigma_log2)[None]


def test_a_response_of_another_method_is_read(tmp_path: Path) -> None:
    data = json.loads(profile().model_dump_json())
    data["cameras"]["outdoor"]["response"]["method"] = "robertson"
    (tmp_path / "calibration.json").write_text(json.dumps(data))
    response = load_profile(tmp_path / "calibration.json").cameras[Side.OUTDOOR].response
    assert response is not None
    assert response.curve().method == "robertson"


def test_shutter_takes_the_measured_time_else_the_rule() -> None:
    shutter = profile().cameras[Side.OUTDOOR].shutter
    assert shutter.true_s(1 / 8000) == 1.21e-4
    assert shutter.true_s(1 / 60) == 2**-6


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda d: d["k2"].update(value=-1), "k2.value"),
        (lambda d: d["k2"].update(surprise=1), "k2.surprise"),
        (lambda d: d["cameras"]["outdoor"]["response"]["log2_exposure"][0].reverse(), "increases"),
        (lambda d: d["cameras"]["outdoor"]["response"]["log2_exposure"][0].pop(), "same number"),
        (lambda d: d["cameras"]["outdoor"]["vignetting"].update(powers=[2]), "as many powers"),
        (lambda d: d.update(schema_version=2), "schema 2"),
        (lambda d: d["cameras"].update(sideways={}), "cameras"),
    ],
)
def test_what_cannot_be_right_is_named(tmp_path: Path, change: object, named: str) -> None:
    path = tmp_path / "calibration.json"
    data = json.loads(profile().model_dump_json())
    change(data)  # type: ignore[operator]
    path.write_text(json.dumps(data))
    with pytest.raises(ProfileError, match=named) as caught:
        load_profile(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"[]", b"{nonsense", b'{"k2": NaN}', b"\xff\xfe", b"[" * 5000])
def test_damage_is_a_profile_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "calibration.json"
    path.write_bytes(content)
    with pytest.raises(ProfileError, match=r"calibration\.json"):
        load_profile(path)


def test_a_missing_profile_or_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="no such profile"):
        load_profile(tmp_path / "none.json")
    with pytest.raises(ProfileError, match="nowhere"):
        load_profile(tmp_path / "nowhere" / "none.json")
    with pytest.raises(ProfileError, match="folder"):
        save_profile(tmp_path / "nowhere" / "x.json", profile())


def test_k2_holds_for_its_settings_only() -> None:
    made = profile()
    assert require_k2(made, {Side.INDOOR: INDOOR, Side.OUTDOOR: OUTDOOR}).value == 2.117
    for change in ({"iso": 400}, {"f_number": 8.0}, {"serial": "3"}, {"nd_filter": ""}, {"color_temperature_k": 5000}):
        other = OUTDOOR.model_copy(update=change)
        with pytest.raises(ProfileError, match=next(iter(change))):
            require_k2(made, {Side.OUTDOOR: other})
    require_k2(made, {Side.OUTDOOR: OUTDOOR.model_copy(update={"f_number": 16.05, "lens": "8 MM"})})
    require_k2(made, {Side.OUTDOOR: CameraState()})  # nothing known, nothing to compare
    with pytest.raises(ProfileError, match="no k2"):
        require_k2(made.model_copy(update={"k2": None}), {})


def test_the_charts_spectral_mismatch_is_each_cameras_own_at_the_settings_of_the_profile() -> None:
    published = luminance_cd_m2(reflectances()).astype(float)
    equal, clipped = reflectances().mean(axis=1), "yellow"
    patches = [
        PatchRecord(
            name=name,
            indoor=100 * published[n],
            outdoor=3 * equal[n],
            residual_stops=0.0 if name == clipped else 0.01,
            color_difference=1.0,
        )
        for n, name in enumerate(PATCH_NAMES)
    ]
    made = profile()
    assert made.k2 is not None
    made = made.model_copy(update={"k2": made.k2.model_copy(update={"patches": tuple(patches)})})
    body, session = INDOOR.model_dump(include={"kind", "model", "serial"}), manifest()
    other = DeviceRecord(role="indoor", **(body | {"serial": "another"}))
    found = chart_mismatches(made, session.model_copy(update={"devices": ()}))
    assert found[Side.INDOOR] == pytest.approx(0.0, abs=1e-4)
    assert found[Side.OUTDOOR] == pytest.approx(0.4, abs=0.05)  # blue patches twice as bright
    assert set(chart_mismatches(made, session.model_copy(update={"devices": (other,)}))) == {Side.OUTDOOR}
    assert chart_mismatches(profile(), session.model_copy(update={"devices": ()}))[Side.INDOOR] is None
    assert chart_mismatches(None, session) == {}


def test_disagreements_are_listed() -> None:
    device = DeviceRecord(
        role="outdoor",
        kind="canon_5d2",
        serial="2",
        lens="8 mm",
        nd_filter="ND 3.0",
        settings=(SettingRecord(name="colour temperature", asked="5200 K", got="5200 K"),),
    )
    assert camera_state(device).color_temperature_k == 5200
    found = profile_matches(profile(), Side.OUTDOOR, device)
    assert len(found) == 1
    assert "5200" in found[0]
    empty = RigProfile(created_utc=NOW)
    styled = [SettingRecord(name="picture style", asked="", got=got) for got in ("neutral", "standard", "not reported")]
    states = [camera_state(device.model_copy(update={"settings": (one,)})) for one in styled]
    assert states[0].differences(states[1]) == ["picture style is standard, in the profile neutral"]
    assert states[0].differences(states[2]) == states[0].differences(states[0]) == []
    bare = CameraProfile(side=Side.OUTDOOR, state=states[0], created_utc=NOW)
    session = SessionManifest.model_construct(devices=(device.model_copy(update={"settings": styled[1:2]}),), frames=())
    warned = unlike_profile(RigProfile(created_utc=NOW, cameras={Side.OUTDOOR: bare}), session)
    assert warned == ["outdoor: picture style is standard, in the profile neutral"]
    assert unlike_profile(profile(), session) == unlike_profile(None, session) == []
    assert profile_matches(empty, Side.INDOOR, None) == ["indoor: the profile does not include this camera"]
