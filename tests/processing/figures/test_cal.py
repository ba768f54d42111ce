"""Radiance's .cal files: what they say is what is done to the picture, and what cannot be done is refused by name."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.shared_data import DATA
from processing.calibration.scale.vignetting import published_vignetting
from processing.errors import ParameterError, PictureFileError
from processing.figures.cal import read_cal
from processing.figures.foreign import applied
from processing.pictures.images import LuminanceImage
from processing.pictures.modes import modes_of
from processing.sphere import Equirectangular, Fisheye, LensMapping, directions

BY_SF = "ro=sf*ri(1);go=sf*gi(1);bo=sf*bi(1);\n"
LENS = Fisheye(401, 401, LensMapping.EQUISOLID, 200)
PUBLISHED = "brackets/canon5d2_8mm_bracket/calibration_files"


def radius(n: float, edge: float | None = None) -> str:
    return f"sq(x)=x*x;\r\nr=sqrt(sq(x-{n})+sq(y-{n}))/{edge or n};\r\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "some.cal"
    path.write_text(text)
    return path


def along(folder: Path, text: str) -> np.ndarray:
    """Return the factors of green from the middle to the right edge of the circle."""
    return read_cal(written(folder, text)).factors(LENS)[200, 200:, 1]


R = np.arange(201) / 200  # of the circle's radius, along that line
THETA = 2 * np.arcsin(R * math.sin(math.pi / 4)) / (math.pi / 2)  # angle over half the field there (equisolid)


@pytest.mark.parametrize(
    ("text", "falloff"),
    [
        (radius(1806) + "sf=1/(-0.2*r^2-0.1*r^4+1);" + BY_SF, 1 - 0.2 * R**2 - 0.1 * R**4),
        (radius(1806) + "sf=1/(((-0.5001)*(r^2))+((1.5e-18)*r)+1);" + BY_SF, 1 - 0.5001 * R**2),
        (radius(1500) + "sf=1/(1-.3*r^2);" + BY_SF, 1 - 0.3 * R**2),
        (radius(500) + "sf=1/(1-.3*r^2);" + BY_SF, 1 - 0.3 * THETA**2),
        (
            radius(900) + "sf=1/(0.9996-.0139*r+.0506*r^2-.1349*r^3);" + BY_SF,
            0.9996 - 0.0139 * R + 0.0506 * R**2 - 0.1349 * R**3,
        ),
        (
            radius(900) + "vign(r)=1-.2*r^2; ro=ri(1)/vign(r);go=gi(1)/vign(r);bo=bi(1)/vign(r)",
            1 - 0.2 * R**2,
        ),
        ("xc:1200;{ its middle } r=sqrt((x-xc)^2+(xc-y)^2)/xc;sf=1/(1+-r^2);" + BY_SF, 1 + R**2),
        (
            "a=90*sqrt((2*(x/xmax-.5))^2+(2*(y/ymax-.5))^2); c=if(a-95, 0, 1/(0.97+atan(0.1*a-4)/PI*0.1));"
            "ro=c*ri(1);go=c*gi(1);bo=c*bi(1);",
            0.97 + np.arctan(9 * R - 4) / math.pi * 0.1,
        ),
    ],
)
def test_a_falloff_is_what_the_file_says(tmp_path: Path, text: str, falloff: np.ndarray) -> None:
    np.testing.assert_allclose(along(tmp_path, text), 1 / falloff, rtol=1e-5)


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("ro=2.0*ri(1);\ngo=gi(1)*2.0;\nbo=2.0*bi(1);", 2.0),
        ("ro=1.18e2*ri(1);go=1.18e2*gi(1);bo=1.18e2*bi(1)", 118.0),
        ("ro=ri(1)/2;go=gi(1)/2;bo=bi(1)/2", 0.5),
        ("f : 3; g(n) = n*f; ro=g(2)*ri(1);go=g(2)*gi(1);bo=g(2)*bi(1)", 6.0),
        ("ro=max(2,3)*ri(1)*2^3^0;go=6*gi(1);bo=-(-6)*bi(1)", 6.0),
    ],
)
def test_factors_are_read_and_applied(tmp_path: Path, text: str, factor: float) -> None:
    found, image = read_cal(written(tmp_path, text)), panorama()
    np.testing.assert_allclose(applied(image, [found]).rgb, factor * image.rgb)
    assert found.gains == pytest.approx((factor,) * 3)
    assert modes_of(applied(image, [found])) == ()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "ro"),
        ("ro=ri(1);", "go"),
        ("sf=oops", "ro"),
        ("ro=oops*ri(1);go=gi(1);bo=bi(1)", "oops"),
        ("1/2", "defines nothing"),
        (radius(500) + "sf=1/(((---)*r^2)+1);" + BY_SF, "invalid syntax"),
        (radius(500) + "sf=1/(((-0.5)*r^4)+((1.2.3)*r^2)+1);" + BY_SF, "invalid"),
        (radius(500) + "sf=1/(((1e400)*r^2)+1);" + BY_SF, "factors are"),
        (radius(500) + "sf=1/(1-1.3*r^2);" + BY_SF, "factors are"),
        ("ro=0*ri(1);go=gi(1);bo=bi(1);", "factors are 0"),
        ("ro=ri(1)+gi(1);go=gi(1);bo=bi(1)", "each channel separately"),
        ("ro=ri(1)^2;go=gi(1);bo=bi(1)", "each channel separately"),
        ("ro=ri(1)/ri(2);go=gi(1)/gi(2);bo=bi(1)/bi(2)", "combines"),
        ("ro=ri(1,x/9,y/9);go=gi(1);bo=bi(1)", "moves"),
        ("ro=sqrt(2,3,4)*ri(1);go=gi(1);bo=bi(1)", "sqrt of 3"),
        ("ro=__import__(1)*ri(1);go=gi(1);bo=bi(1)", "not known"),
        ("ro=ri(1)if 1else 2;go=gi(1);bo=bi(1)", "invalid"),
        ("ro=ri(1,n=2);go=gi(1);bo=bi(1)", "not Radiance's"),
        ("ro=ri(1)*[2];go=gi(1);bo=bi(1)", "not Radiance's"),
        ("a=b;b=a;ro=a*ri(1);go=gi(1);bo=bi(1)", "recursion"),
        ("ro=ri(1)*" + "(" * 5000 + "1" + ")" * 5000 + ";go=gi(1);bo=bi(1)", "nested"),
        (
            "f0(n)=n;" + "".join(f"f{i + 1}(n)=f{i}(n)+f{i}(n);" for i in range(60)) + "ro=f60(1)*ri(1);go=1;bo=1",
            "end",
        ),
        ("r=((x/1000-.5)^2+(y/1000-.5)^2)^.5*2;sf=1/(1-.1*r^2);" + BY_SF, "N is not there"),
        (radius(500, 480) + "sf=1/(1-.3*r^2);" + BY_SF, "1.04"),
        ("r=sqrt((x-2831)^2+(y-1864)^2)/1806;sf=1/(1-.3*r^2);" + BY_SF, "1864.0, 2831.0"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(PictureFileError, match=reason) as caught:
        read_cal(written(tmp_path, text))
    assert caught.value.where == "some.cal"


def test_the_page_shows_a_file_that_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/reference/light-figures.md").read_text("utf-8")
    found = along(tmp_path, next(part for part in page.split("```") if "ro = ri(1) /" in part))
    np.testing.assert_allclose(found, 1 / (1 + 0.1466 * R**2 - 0.4 * R**4), rtol=1e-5)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(PictureFileError, match="cannot be read"):
        read_cal(tmp_path / "none.cal")


def test_a_lens_file_needs_a_fisheye_and_has_its_doubt(tmp_path: Path) -> None:
    found = read_cal(written(tmp_path, radius(500) + "sf=1/(1-.3*r^2);" + BY_SF))
    with pytest.raises(ParameterError, match="fisheye"):
        applied(panorama(), [found])
    lens = Fisheye(80, 80, LensMapping.EQUIDISTANT, 40)
    _, seen = directions(lens)
    rgb = np.repeat(seen[..., None], 3, axis=2).astype(np.float32)
    fisheye = LuminanceImage(rgb, np.zeros((80, 80), np.float32), np.where(seen, 0, 3).astype(np.uint8), lens, 0.0)
    lit = applied(fisheye, [found])
    assert lit.rgb[40, 1, 0] == pytest.approx(1 / (1 - 0.3 * (38.5 / 40) ** 2), rel=1e-3)
    assert lit.rgb[40, 40, 0] == pytest.approx(1, rel=1e-3)
    assert len(modes_of(lit)) == 1


@pytest.mark.shared(PUBLISHED)
def test_published_files_say_what_is_built_in() -> None:
    for name, built_in in (("f5d6", "canon_8mm_f5_6"), ("f8", "canon_8mm_f8"), ("f11", "canon_8mm_f11")):
        found = read_cal(DATA / PUBLISHED / f"vignetting_{name}.cal").factors(LENS)
        np.testing.assert_allclose(found[..., 1], 1 / published_vignetting(built_in).map(LENS), rtol=1e-5)
    assert read_cal(DATA / PUBLISHED / "CF_f5d6.cal").gains == (1.18, 1.18, 1.18)
    assert read_cal(DATA / PUBLISHED / "NDfilter_transform.cal").gains == (793.2549, 811.7736, 1196.992)
    with pytest.raises(PictureFileError, match="view"):
        read_cal(DATA / PUBLISHED / "fisheye_corr.cal")


def panorama() -> LuminanceImage:
    flat = np.zeros((8, 16), np.float32)
    return LuminanceImage(np.ones((8, 16, 3), np.float32), flat, flat.astype(np.uint8), Equirectangular(16, 8), 0.0)
