"""`python -m training.response_prior FOLDER`: the table of principal response curves from published ones.

FOLDER holds `response_curves.csv`: a row a curve, brightness 0..1 over irradiance 0..1 (Database of Response Functions,
Columbia University; Grossberg and Nayar, Modeling the Space of Camera Response Functions, TPAMI 2004). Digital
standards are added. Only our own fit is kept: mean and six principal differences, 26 spline coefficients each.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from processing.calibration.response.fit import spline_basis, srgb_log2_exposure
from processing.calibration.response.prior import PrincipalCurves
from processing.ground.arrays import Doubles

TABLE = Path(__file__).parents[1] / "processing" / "calibration" / "response_prior.toml"
COMPONENTS = 6  # chosen on the curves left out: 5 to 8 are alike, all 26 worse
TAIL, DEGREES = 4.0, 12.0
"""Of Student's t, so that a few digitised curves with steps do not widen the spread of all."""
MIDDLE = 128
"""Code at which curves are 0."""
GAMMAS = (1.8, 2.0, 2.2, 2.4, 2.6)
CONTRASTS = (0.0, 0.15, 0.3, 0.45)


def published_curves(folder: Path) -> tuple[list[int], Doubles, Doubles]:
    """Return the curves' numbers, irradiance (N,) and brightness (curves, N), both 0..1."""
    with (folder / "response_curves.csv").open(encoding="utf-8") as file:
        rows = list(csv.reader(file))
    values = np.array([[float(v) for v in row[1:]] for row in rows])
    return [int(row[0]) for row in rows[1:]], values[0], values[1:]


def log2_exposure(irradiance: Doubles, brightness: Doubles) -> Doubles:
    """Return log2 of the irradiance (256,) that gives each code, the curve read as straight between its points."""
    rising = np.maximum.accumulate(brightness) + np.arange(len(brightness)) * 1e-9
    rising = (rising - rising[0]) / (rising[-1] - rising[0])
    codes = np.clip(np.arange(256), 0.25, 255) / 255
    return np.asarray(np.log2(np.maximum(np.interp(codes, rising, irradiance), 1e-9)))


def digital_curves() -> list[Doubles]:
    """Return log2 exposure (256,) of powers, and of sRGB with more and more contrast."""
    codes = np.maximum(np.arange(256), 0.5) / 255
    light = np.linspace(0, 1, 4097)
    srgb = np.where(light < 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    curves = [gamma * np.log2(codes) for gamma in GAMMAS]
    for contrast in CONTRASTS:
        shown = srgb + contrast * (srgb * srgb * (3 - 2 * srgb) - srgb)
        curves.append(np.log2(np.maximum(np.interp(codes, shown, light), 1e-9)))
    return curves


def principal_curves(curves: Sequence[Doubles]) -> PrincipalCurves:
    """Return mean and principal differences of curves of log2 exposure, (256,) each."""
    basis = spline_basis()
    weight = np.ones(256)
    # The ends of digitised curves are extrapolated, or a single step wide.
    weight[:3], weight[253:] = 0.05, 0.3
    rows = basis.codes * weight[:, None]
    whole = rows.T @ rows + 1e-4 * basis.penalty + 1e-9 * np.eye(len(basis.penalty))
    apart = np.stack([curve - curve[MIDDLE] for curve in curves]) - (
        srgb_log2_exposure() - srgb_log2_exposure()[MIDDLE]
    )
    found = np.linalg.solve(whole, rows.T @ (apart * weight).T).T
    floor = 0.3 * np.linalg.inv(10.0**4.5 * basis.penalty + 1e-2 * np.eye(len(basis.penalty)))
    share = np.ones(len(found))
    for _ in range(30):
        mean = share @ found / share.sum()
        spread = (share[:, None] * (found - mean)).T @ (found - mean) / share.sum()
        far2 = np.einsum("ni,ij,nj->n", found - mean, np.linalg.inv(spread + floor), found - mean)
        share = (TAIL + DEGREES) / (TAIL + far2)
    size, ways = np.linalg.eigh(spread)
    largest = np.argsort(size)[::-1][:COMPONENTS]
    return PrincipalCurves(mean, (ways[:, largest] * np.sqrt(size[largest])).T)


def main(folder: Path) -> None:
    """Write the table."""
    _, irradiance, brightness = published_curves(folder)
    fit = principal_curves([*(log2_exposure(irradiance, one) for one in brightness), *digital_curves()])
    rows = ",\n".join(f"  [{', '.join(f'{v:.5f}' for v in row)}]" for row in fit.components)
    TABLE.write_text(
        "# Principal response curves: 26 coefficients each of a spline that is added to sRGB's curve (log2 exposure).\n"
        f"# Our fit to {len(brightness)} curves of the Database of Response Functions (Grossberg and Nayar 2004) and\n"
        f"# {len(digital_curves())} digital ones; made by `python -m training.response_prior FOLDER`.\n"
        f"mean = [{', '.join(f'{v:.5f}' for v in fit.mean)}]\ncomponents = [\n{rows},\n]\n",
        "utf-8",
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
