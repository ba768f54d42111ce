"""Plots of the report: PNG or SVG as bytes, of plain arrays. The same numbers give the same bytes.

Colours of the channels differ in line style, too. No plot touches matplotlib's global state.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from processing.errors import ParameterError
from processing.ground.arrays import Bytes, Doubles, Floats
from processing.ground.colour import colour_temperature_k
from processing.pictures.display import AS_GIVEN
from processing.pictures.false_colour import display_range, false_colour, legend, uncertainty_picture, with_legend
from processing.pictures.preview import jpeg_bytes, png_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


CHANNELS = (("red", "#c92a2a", "-"), ("green", "#2b8a3e", "--"), ("blue", "#1864ab", ":"))
_SIZE_IN = (7.2, 3.8)
_COVERAGE = 2.0  # bands are plus and minus two standard uncertainties
CCT_RANGE_K = (2000.0, 20000.0)
PAGE_WIDTH_PX = 1200  # chosen: a page's width


def every_nth(picture: Floats) -> slice:
    """Return which rows and columns of a picture, shape (H, W, 3) or (H, W), a page shows: `PAGE_WIDTH_PX` at most."""
    step = max(1, -(-picture.shape[1] // PAGE_WIDTH_PX))
    return slice(step // 2, None, step)


def response_plot(log2_exposure: Doubles, sigma_log2: Doubles, low: Sequence[int], high: Sequence[int]) -> bytes:
    """Return an SVG of response curves: exposure in stops, shape (3, N), over codes.

    ``sigma_log2``: (3, N) standard uncertainty in stops, of which a band shows two. Outside ``low[c]..high[c]`` the
    curve is extrapolated and drawn faintly.
    """
    figure, axes = _figure()
    codes = np.arange(log2_exposure.shape[1])
    for channel, (name, colour, style) in enumerate(CHANNELS):
        stops, sigma = log2_exposure[channel], _COVERAGE * sigma_log2[channel]
        inside = slice(low[channel], high[channel] + 1)
        axes.plot(codes, stops, color=colour, linewidth=0.6, alpha=0.4)
        axes.plot(codes[inside], stops[inside], style, color=colour, linewidth=1.6, label=name)
        axes.fill_between(codes[inside], (stops - sigma)[inside], (stops + sigma)[inside], color=colour, alpha=0.18)
    shown = [log2_exposure[c, low[c] : high[c] + 1] for c in range(3)]
    axes.set_ylim(min(float(s.min()) for s in shown) - 0.5, max(float(s.max()) for s in shown) + 0.5)
    axes.set(xlabel="code", ylabel="exposure (stops)")
    axes.legend(frameon=False)
    return svg_bytes(figure)


def residual_plot(codes: Doubles, residual_stops: Doubles) -> bytes:
    """Return an SVG of root-mean-square residuals (3, N) in stops at codes (N,); NaN where there is no sample."""
    figure, axes = _figure()
    for channel, (name, colour, style) in enumerate(CHANNELS):
        axes.plot(codes, residual_stops[channel], style, color=colour, linewidth=1.2, label=name)
    axes.set(xlabel="code", ylabel="residual, rms (stops)")
    axes.set_ylim(bottom=0)
    axes.legend(frameon=False)
    return svg_bytes(figure)


def frame_usage_plot(labels: Sequence[str], shares: Sequence[float], left_out: Sequence[bool]) -> bytes:
    """Return an SVG of how much of the picture each frame serves, 0 to 1; frames that were left out say so."""
    if not len(labels) == len(shares) == len(left_out) > 0:
        raise ParameterError("frames, their shares and what was left out are of one length, above 0")
    figure, axes = _figure(height_in=0.9 + 0.32 * len(labels))
    places = np.arange(len(labels))[::-1]
    axes.barh(places, [100 * share for share in shares], height=0.6, color="#1864ab")
    for place, share, out in zip(places, shares, left_out, strict=True):
        label = "left out" if out else f"{100 * share:.1f} %"
        axes.text(100 * share + 1, place, label, va="center", fontsize=9, color="#868e96" if out else "#212529")
    axes.set_yticks(places, labels)
    axes.set(xlim=(0, 112), xticks=range(0, 101, 20), xlabel="part of the picture that the frame serves (%)")
    return svg_bytes(figure)


def contact_sheet(thumbnails: Sequence[Bytes], labels: Sequence[str], *, columns: int = 3) -> bytes:
    """Return a PNG of a bracket: each frame small, uint8 (H, W, 3), its histogram by channel below, and its label."""
    from PIL import Image, ImageColor, ImageDraw, ImageFont

    if not thumbnails or len(thumbnails) != len(labels):
        raise ParameterError("a contact sheet has frames, and as many labels")
    rows, high = -(-len(thumbnails) // columns), round(280 * thumbnails[0].shape[0] / thumbnails[0].shape[1])
    sheet, font = Image.new("RGB", (300 * columns, rows * (high + 115)), "white"), ImageFont.load_default(12)
    pen, codes = ImageDraw.Draw(sheet), np.arange(280) * 256 // 280
    for number, (picture, label) in enumerate(zip(thumbnails, labels, strict=True)):
        left, top = 300 * (number % columns) + 10, number // columns * (high + 115) + 25
        sheet.paste(Image.fromarray(np.ascontiguousarray(picture)).resize((280, high)), (left, top))
        pen.text((left + 140, top - 6), label, "black", font, "ms")
        tall = np.sqrt([np.bincount(picture[..., c].ravel(), minlength=256) for c in range(3)])
        below = np.arange(60, 0, -1)[:, None] <= 60 / tall.max() * tall[:, None, codes]
        shown = np.full((60, 280, 3), 255.0)
        for filled, (_, colour, _) in zip(below, CHANNELS, strict=True):
            shown[filled] += 0.35 * (np.array(ImageColor.getrgb(colour)) - shown[filled])
        sheet.paste(Image.fromarray(shown.astype(np.uint8)), (left, top + high + 5))
        for code in (0, 128, 255):
            pen.text((left + code * 279 / 255, top + high + 68), str(code), "black", font, "mt")
    return png_bytes(np.asarray(sheet))


def spot_picture(rgb: Floats, centre_px: tuple[float, float], radius_px: float, *, size_px: int = 480) -> bytes:
    """Return a PNG of where the meter looked: the linear picture around its spot, and the spot's circle.

    ``rgb``: (H, W, 3) linear light >= 0. The crop is sixteen spots wide, wraps around at the sides, and is
    cut at top and bottom.
    """
    import cv2

    height, width = rgb.shape[:2]
    if not (0 <= centre_px[0] <= width and 0 <= centre_px[1] <= height and radius_px > 0):
        raise ParameterError(f"a spot at {centre_px} is not in a picture of {width} x {height}")
    half = min(max(8, round(16 * radius_px)), height // 2, width // 2)
    left = int(centre_px[0]) - half
    top = min(max(0, int(centre_px[1]) - half), height - 2 * half)
    crop = rgb[top : top + 2 * half, np.arange(left, left + 2 * half) % width]
    scale = size_px / (2 * half)
    shown = cv2.resize(AS_GIVEN.exposed(crop).shown(crop), (size_px, size_px), interpolation=cv2.INTER_NEAREST)
    # Drawn with four binary places: cv2 has the first pixel's centre at 0, we have it at 0.5.
    place = [round(((c - corner) * scale - 0.5) * 16) for c, corner in zip(centre_px, (left, top), strict=True)]
    for colour, thick in (((0, 0, 0), 4), ((255, 220, 0), 2)):
        cv2.circle(shown, (place[0], place[1]), max(16, round(radius_px * scale * 16)), colour, thick, cv2.LINE_AA, 4)
    return png_bytes(np.asarray(shown, dtype=np.uint8))


def luminance_picture(luminance: Floats, unit: str = "cd/m2") -> bytes:
    """Return a JPEG (4:4:4) of luminance (H, W) in false colours with its scale, at most `PAGE_WIDTH_PX` wide."""
    small = _shrunk(luminance)
    low, high = display_range(small)
    return jpeg_bytes(with_legend(false_colour(small, low, high), legend(low, high, unit, small.shape[0])))


def uncertainty_map(uncertainty: Floats) -> bytes:
    """Return a JPEG (4:4:4) of relative standard uncertainty (H, W) in per cent with its scale; grey: nothing known."""
    picture = uncertainty_picture(_shrunk(uncertainty))
    return jpeg_bytes(with_legend(picture, legend(0.1, 100.0, "%", picture.shape[0], colours="viridis")))


def cct_picture(rgb: Floats) -> bytes:
    """Return a JPEG (4:4:4) of the colour temperature of linear ``rgb`` (H, W, 3) with its scale; grey: it has none."""
    kelvin, meaningful = colour_temperature_k(_shrunk(rgb))
    shown = np.where(meaningful, np.clip(kelvin, *CCT_RANGE_K), 0)
    return jpeg_bytes(with_legend(false_colour(shown, *CCT_RANGE_K), legend(*CCT_RANGE_K, "K", shown.shape[0])))


def _shrunk(values: Floats) -> Floats:
    """Return every n-th pixel: numbers stay numbers of the picture, no means of valid and invalid."""
    return values[every_nth(values), every_nth(values)]


def empty_figure(width_in: float, height_in: float) -> Figure:
    """Return a white figure of our own, apart from matplotlib's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=100, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def plan_plot(
    floor_m: Sequence[tuple[float, float]],
    openings: Sequence[tuple[str, tuple[float, float], tuple[float, float]]] = (),
) -> bytes:
    """Return an SVG of a floor plan seen from above: walls by number, openings by kind, the camera at (0, 0)."""
    figure, axes = _figure(5.2)
    corners = [*floor_m, floor_m[0]]
    axes.plot([x for x, _ in corners], [y for _, y in corners], color="#343a40", linewidth=2.5)
    for wall, ((x0, y0), (x1, y1)) in enumerate(itertools.pairwise(corners)):
        axes.annotate(str(wall), ((x0 + x1) / 2, (y0 + y1) / 2), fontsize=8, color="#868e96")
    colours = {"window": "#1c7ed6", "door": "#e8590c", "passage": "#9c36b5"}
    for kind in colours:
        for k, (a, b) in enumerate([(a, b) for name, a, b in openings if name == kind]):
            label = kind if k == 0 else None
            axes.plot([a[0], b[0]], [a[1], b[1]], color=colours[kind], linewidth=5, solid_capstyle="butt", label=label)
    axes.plot([0], [0], "^", color="#2b8a3e", label="camera")
    axes.set(aspect="equal", xlabel="m to the right", ylabel="m ahead")
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return svg_bytes(figure)


def _figure(height_in: float = _SIZE_IN[1]) -> tuple[Figure, Any]:
    figure = empty_figure(_SIZE_IN[0], height_in)
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(visible=True, linewidth=0.4, alpha=0.5)
    axes.set_axisbelow(True)
    return figure, axes


def svg_bytes(figure: Figure) -> bytes:
    """Return a figure as SVG, the same bytes for the same figure."""
    import matplotlib as mpl

    out = io.BytesIO()
    # Without the salt identifiers are random; without the date the bytes are those of the numbers.
    with mpl.rc_context({"svg.hashsalt": "daylit", "svg.fonttype": "path"}):
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None})
    return out.getvalue()
