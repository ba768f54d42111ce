"""Rigs whose cameras, filter and meter see spectra, and whose lenses are copies that no table describes.

Each draw is another rig: two cameras of measured spectral sensitivities (colour-science's data sets: a Bayer filter's,
with up to half of a layered sensor's, shifted by some nanometres), each with its maker's matrix from a chart in
daylight; a density filter of 3.0 that is neither neutral nor a matrix (a slope and a bow over wavelength, more light
beyond 650 nm); a meter whose V(lambda) is off; chart and lamps as published. The fisheye is a copy: its mapping is the
equisolid one times 1 + a theta2, its axis is off the middle of its circle, and its fall-off ends in a knee that no
polynomial of the estimator's is. The rig is calibrated as the product does it: the chart in both cameras, a flat field;
then a room is scaled by its meter, and a sky, which is bluer the farther from the sun, measured. Frames are merged
already: curves have figures of their own.

Indoors (`spectral_indoor_*`) a room of the same rig: walls, floor and coloured things (the chart's spectra) in daylight
from one side, in half of the rigs also in a lamp's light from the other, and a window of blue sky; its meter read a
white board somewhere along the walls. Five planes a room, errors and coverage over all.

Errors: horizontal illuminance of the sky against the truth; whether it lies within its stated 95 % interval; colour of
the zenith, the larger of red and blue over green against what the indoor camera would show of it. The certificate's
spectral mismatch (published colours) stands beside the true one (V(lambda) on the patches' spectra under that lamp).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from processing.calibration.outdoor import outdoor
from processing.calibration.outdoor.lens import ImageCircle, LensModel
from processing.calibration.outdoor.outdoor import OutdoorOptics
from processing.calibration.outdoor.session_sky import with_shared_modes
from processing.calibration.scale.chart import ChartView, scale_from_charts, spectral_mismatch
from processing.calibration.scale.chart_patches import WHITE, FoundChart
from processing.calibration.scale.luminance import CURVE_FRAC, LS160, ScaleFactor, combined, scaled
from processing.calibration.scale.photometry import PLANES, illuminances
from processing.calibration.scale.vignetting import fit_flat
from processing.ground.arrays import Doubles, Floats
from processing.ground.colour import LUMINANCE_WEIGHTS
from processing.pictures.images import RelativeImage, Validity, luminance_cd_m2
from processing.pictures.modes import blueness, colour_mode, widened
from processing.rig.calibrate import one_colour
from processing.sphere import LensMapping

LAMPS = ("LED-B3", "LED-B5", "LED-V2", "FL4", "A")
PATCH_NOISE = 0.003
METER_SIGMA = 0.012
SKY_PX = 320
FLAT_POWERS = (2, 4, 6, 8)
ROOM_PX, THINGS, TINTED = (24, 48), 8, 0.3
"""Rows and columns of the room's panorama; coloured things in it; the share of a colour in its walls' white."""


@dataclass(frozen=True)
class Spectra:
    """What all rigs share, at wavelengths of 5 nm from 400 to 700."""

    nm: Doubles
    cameras: tuple[Doubles, ...]
    """(N, 3) each."""
    eye: Doubles
    patches: Doubles
    """(24, N)."""
    lamps: tuple[Doubles, ...]
    daylight: Doubles
    """(3, N): S0, S1, S2."""

    def sun(self, kelvin: Doubles | float) -> Doubles:
        """Return daylight (..., N) of colour temperatures (...), luminance 1 (CIE 15, 4000 to 25,000 K)."""
        t = np.asarray(kelvin, dtype=float)[..., None]
        near = -4.6070e9 / t**3 + 2.9678e6 / t**2 + 0.09911e3 / t + 0.244063
        far = -2.0064e9 / t**3 + 1.9018e6 / t**2 + 0.24748e3 / t + 0.237040
        x = np.where(t <= 7000, near, far)
        y = -3 * x * x + 2.870 * x - 0.275
        of = 0.0241 + 0.2562 * x - 0.7341 * y
        light = self.daylight[0] + (-1.3515 - 1.7703 * x + 5.9114 * y) / of * self.daylight[1]
        light = light + (0.03 - 31.4424 * x + 30.0717 * y) / of * self.daylight[2]
        return np.asarray(light / (light @ self.eye)[..., None])


def spectra() -> Spectra:
    """Return colour-science's data."""
    import colour
    from colour.colorimetry import SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES

    shape = colour.SpectralShape(400, 700, 5)

    def table(one: object) -> Doubles:
        return np.asarray(one.copy().align(shape).values, dtype=float)  # type: ignore[attr-defined]

    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"]
    eye = table(colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"])
    lamps = [table(colour.SDS_ILLUMINANTS[name]) for name in LAMPS]
    return Spectra(
        np.arange(400.0, 701, 5),
        tuple(table(one) for one in colour.MSDS_CAMERA_SENSITIVITIES.values()),
        eye / eye.sum(),
        np.stack([table(one) for one in chart.values()]),
        tuple(lamp / (lamp @ eye) for lamp in lamps),
        np.stack([table(SDS_BASIS_FUNCTIONS_CIE_ILLUMINANT_D_SERIES[name]) for name in ("S0", "S1", "S2")]),
    )


def spectral_figures(draws: int, seed: int) -> dict[str, float]:
    """Return errors and coverage over ``draws`` rigs."""
    data, rows, planes = spectra(), [], []
    for k in range(draws):
        row, room = _one(data, np.random.default_rng((seed, 17, k)))
        rows.append(row)
        planes += room
    error, within, colour, index, mismatch = np.array(rows).T
    indoor, sigmas = np.array(planes).T
    return {
        "spectral_lux_err_pct": 100 * float(np.median(np.abs(error))),
        "spectral_lux_worst_pct": 100 * float(np.max(np.abs(error))),
        "spectral_lux_cover95_pct": 100 * float(np.mean(within)),
        "spectral_indoor_lux_err_pct": 100 * float(np.median(np.abs(indoor))),
        "spectral_indoor_lux_worst_pct": 100 * float(np.max(np.abs(indoor))),
        "spectral_indoor_lux_cover95_pct": 100 * float(np.mean(sigmas <= 1.96)),
        "spectral_zenith_colour_pct": 100 * float(np.median(colour)),
        "spectral_mismatch_pct": 100 * float(np.median(index)),
        "spectral_mismatch_true_pct": 100 * float(np.median(mismatch)),
    }


def _camera(data: Spectra, rng: np.random.Generator) -> tuple[Doubles, Doubles]:
    """Return a copy's sensitivities (N, 3) and its maker's matrix (3, 3) to linear Rec. 709."""
    shift, share = rng.normal(0, 2.0, 3), rng.uniform(0, 0.5)
    own = sum(part * one / one.sum() for part, one in zip((1 - share, share), data.cameras, strict=True))
    sees = np.stack([np.interp(data.nm, data.nm + shift[c], own[:, c]) for c in range(3)], axis=1)
    sees = sees / (data.sun(6504.0) @ sees)
    import colour

    light = data.patches * data.sun(6504.0)
    shape = colour.SpectralShape(400, 700, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape).values
    xyz = light @ (cmfs / cmfs[:, 1].sum())
    rgb = xyz @ np.linalg.inv(np.array(colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ)).T
    return sees, np.linalg.lstsq(light @ sees, rgb, rcond=None)[0]


def _one(
    data: Spectra, rng: np.random.Generator
) -> tuple[tuple[float, bool, float, float, float], list[tuple[float, float]]]:
    """Return a rig's figures, and of its room's planes relative errors and how many standard deviations they are."""
    [of_room] = rng.spawn(1)
    (inside, to_rgb), (outside, to_rgb_out) = _camera(data, rng), _camera(data, rng)
    bow = (data.nm - 550) / 150
    density = 3.0 - rng.normal(0, 0.08) * bow - rng.normal(0, 0.05) * bow**2 - 0.15 * rng.random() * (data.nm > 650)
    through = 10**-density
    meter = np.interp(data.nm, data.nm + rng.normal(0, 1.5), data.eye) + rng.uniform(0, 0.004) * data.eye.max()
    # A meter is adjusted under illuminant A.
    meter *= (data.lamps[-1] @ data.eye) / (data.lamps[-1] @ meter)

    def seen_in(light: Doubles) -> Doubles:
        return np.asarray(np.maximum(light @ inside @ to_rgb, 1e-9))

    def seen_out(light: Doubles) -> Doubles:
        return np.asarray(np.maximum((light * through * 1e3) @ outside @ to_rgb_out, 1e-9))

    # The rig: a chart under one lamp, seen by both, and a flat field.
    lamp = data.lamps[int(rng.integers(len(data.lamps)))] * 300
    chart = data.patches * lamp
    charts = [
        _chart(rgb * (1 + PATCH_NOISE * rng.standard_normal((24, 1)))) for rgb in (seen_in(chart), seen_out(chart))
    ]
    doubt = np.hypot(charts[0].uncertainty, charts[1].uncertainty)
    tint, view = one_colour(charts[0], ChartView(_picture(np.ones((2, 4, 3), np.float32)), charts[1]), doubt)
    k2 = scale_from_charts(charts[0], view.chart).scale
    copy = _Copy.drawn(rng)
    theta, rays = copy.directions()
    lens = LensModel(LensMapping.EQUISOLID, ImageCircle(copy.centre, copy.radius, (SKY_PX, SKY_PX)))
    flat = copy.falloff(theta)[..., None] * np.ones(3)
    falloff = fit_flat([flat.astype(np.float32)], lens.fisheye(), powers=FLAT_POWERS)
    # The room: a white board in daylight, read by the meter.
    board = 0.9 * data.sun(rng.uniform(4500, 7500)) * (1 - 0.05 * np.abs(bow)) * 100
    reading = float(board @ meter) * (1 + METER_SIGMA * rng.standard_normal())
    displayed = float(seen_in(board) @ np.array(LUMINANCE_WEIGHTS))
    known = math.hypot(METER_SIGMA, CURVE_FRAC, LS160.spectral)
    k1 = ScaleFactor(reading / displayed, known, measured=reading)
    # The sky, from white about the sun to deep blue across from it.
    sun = np.array([0.5, 0.4, 0.77])
    apart = np.arccos(np.clip(rays @ (sun / np.linalg.norm(sun)), -1, 1))
    kelvin = np.clip(5500 + 9000 * apart + 2000 * np.cos(theta), 5000, 25_000)
    level = 3000 * (0.6 + 2.5 * np.exp(-2.5 * apart) + 0.4 * np.sin(theta))
    inside_circle = theta < math.pi / 2
    light = data.sun(kelvin) * (level * inside_circle)[..., None]
    rgb = np.where(inside_circle[..., None], seen_out(light) * copy.falloff(theta)[..., None], 0)
    optics = OutdoorOptics(lens, falloff, tint)
    image = outdoor.with_lens(_picture(rgb.astype(np.float32), lens), optics)
    image = outdoor.correct_colour(outdoor.correct_vignetting(image, optics), optics)
    lit = float(blueness(charts[0].rgb[WHITE]))
    picture = with_shared_modes(scaled(image, combined(k1, k2), k1=k1.value, k2=k2.value), optics, None, (None, lit))
    lux = illuminances(picture, {"up": (0.0, 0.0, 1.0)})[0]["up"]
    truth = _true_lux(sun / np.linalg.norm(sun))
    error = lux["value"] / truth - 1
    zenith = data.sun(float(np.clip(5500 + 9000 * math.acos(sun[2] / np.linalg.norm(sun)) + 2000, 5000, 25_000)))
    row, column = int(copy.centre[1]), int(copy.centre[0])
    shown, true = picture.rgb[row, column].astype(float), seen_in(zenith)
    off = np.abs((shown / shown[1]) / (true / true[1]) - 1)
    against = charts[0].luminance / (chart @ data.eye)
    against = against[:18] / np.median(against[18:]) - 1
    index = spectral_mismatch(charts[0].luminance, charts[0].usable, lit) or math.nan
    within = abs(lux["value"] - truth) <= 1.96 * lux["uncertainty"]
    found = error, within, float(off.max()), index, math.sqrt(float(np.mean(against**2)))
    return found, _indoors(data, of_room, seen_in, meter)


def _indoors(
    data: Spectra, rng: np.random.Generator, seen_in: Callable[[Doubles], Doubles], meter: Doubles
) -> list[tuple[float, float]]:
    """Return relative errors of a room's planes, and the same in stated standard deviations."""
    high, wide = ROOM_PX
    latitude = (90 - (np.arange(high) + 0.5) * 180 / high)[:, None] * np.ones(wide)
    # The share of daylight falls from one side to the other, where the lamp hangs.
    share = 0.5 + 0.5 * np.cos((np.arange(wide) + 0.5) / wide * 2 * math.pi)
    lamp = data.lamps[int(rng.integers(len(data.lamps)))] * rng.choice([0.0, rng.uniform(0.2, 1.0)])
    day = data.sun(rng.uniform(4500, 7500))
    light = share[:, None] * day + (1.1 - share)[:, None] * lamp + 0.1 * day
    paint = data.patches[WHITE] * (1 - TINTED) + TINTED * data.patches[int(rng.integers(18))]
    surfaces = np.where(latitude[..., None] > 35, data.patches[WHITE], paint)
    surfaces = np.where(latitude[..., None] < -25, data.patches[int(rng.integers(2))], surfaces)
    for _ in range(THINGS):
        row, column = int(rng.integers(high // 3, high - 3)), int(rng.integers(wide - 4))
        surfaces[row : row + 3, column : column + 4] = data.patches[int(rng.integers(18))]
    room = surfaces * light * 100
    blue = data.sun(rng.uniform(6500, 20_000))
    room[high // 3 : high // 2, : wide // 10] = blue * rng.uniform(500, 4000)
    at = int(rng.integers(wide))
    board = 0.9 * light[at] * 100
    reading = float(board @ meter) * (1 + METER_SIGMA * rng.standard_normal())
    displayed = float(seen_in(board) @ np.array(LUMINANCE_WEIGHTS))
    k1 = ScaleFactor(reading / displayed, math.hypot(METER_SIGMA, LS160.spectral), measured=reading)
    picture = scaled(_picture(seen_in(room).astype(np.float32)), k1)
    lit = float(blueness(seen_in(board).astype(np.float32)))
    stated = illuminances(widened(picture, [colour_mode(lit, indoors=True)]), PLANES)[0]
    grey = np.repeat((room @ data.eye)[..., None], 3, axis=2).astype(np.float32)
    true = illuminances(scaled(_picture(grey), ScaleFactor(1.0, 0.0)), PLANES)[0]
    off = [(stated[name]["value"] - true[name]["value"], stated[name]["uncertainty"]) for name in PLANES]
    return [(error / true[name]["value"], abs(error) / u) for name, (error, u) in zip(PLANES, off, strict=True)]


@dataclass(frozen=True)
class _Copy:
    """One copy of a fisheye of 180 degrees."""

    centre: tuple[float, float]
    radius: float
    bend: float
    off_axis: tuple[float, float]
    loss: tuple[float, float]

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> _Copy:
        centre = SKY_PX / 2 + rng.normal(0, 2.0, 2)
        off = rng.normal(0, 0.004, 2)
        loss = (float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.05, 0.25)))
        return cls(
            (float(centre[0]), float(centre[1])),
            SKY_PX * 0.48,
            float(rng.normal(0, 0.006)),
            (float(off[0]), float(off[1])),
            loss,
        )

    def directions(self) -> tuple[Doubles, Doubles]:
        """Return each pixel's true angle from the zenith (H, W), beyond pi/2 outside, and direction (H, W, 3)."""
        y, x = np.mgrid[:SKY_PX, :SKY_PX] + 0.5
        right = (x - self.centre[0]) / self.radius - self.off_axis[0]
        up = (self.centre[1] - y) / self.radius - self.off_axis[1]
        radius = np.hypot(right, up)
        angles = np.linspace(0, 1.8, 2000)
        table = (
            np.sin(angles / 2)
            / math.sin(math.pi / 4)
            * (1 + self.bend * angles**2)
            / (1 + self.bend * (math.pi / 2) ** 2)
        )
        theta = np.interp(radius, table, angles)
        flat = np.sin(theta) / np.maximum(radius, 1e-9)
        return theta, np.stack([-right * flat, up * flat, np.cos(theta)], axis=-1)

    def falloff(self, theta: Doubles) -> Doubles:
        """Return what is left of the light: a smooth loss, and a knee towards the edge."""
        smooth, knee = self.loss
        return np.asarray(1 - smooth * np.sin(theta) ** 2 - knee / (1 + np.exp(-(theta - 1.35) / 0.09)))


def _true_lux(sun: Doubles) -> float:
    """Return the horizontal illuminance of the sky, by equal parts of the projected half sphere."""
    square = (np.arange(400) + 0.5) / 400
    sine = np.sqrt(square)[:, None]
    around = (np.arange(800) + 0.5) / 800 * 2 * math.pi
    rays = np.stack(np.broadcast_arrays(sine * np.sin(around), sine * np.cos(around), np.sqrt(1 - sine**2)), axis=-1)
    apart = np.arccos(np.clip(rays @ sun, -1, 1))
    level = 3000 * (0.6 + 2.5 * np.exp(-2.5 * apart) + 0.4 * sine)
    return float(math.pi * level.mean())


def _chart(rgb: Doubles) -> FoundChart:
    return FoundChart(np.zeros((4, 2)), rgb, np.full(24, PATCH_NOISE), np.full(24, 400), 0.05, "corners")


def _picture(rgb: Floats, lens: LensModel | None = None) -> RelativeImage:
    from processing.sphere import Equirectangular

    height, width = rgb.shape[:2]
    geometry = lens.fisheye() if lens else Equirectangular(width, height)
    lit = luminance_cd_m2(rgb) > 0
    validity = np.where(lit, Validity.VALID, Validity.OUTSIDE).astype(np.uint8)
    return RelativeImage(rgb, np.where(lit, np.float32(0.01), np.float32(np.inf)), validity, geometry)
