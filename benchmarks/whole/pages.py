"""The two pages of a report in a real browser: bytes, first paint, accessibility, what they ask of the net.

Of the processed session that ``DAYLIT_BENCH_PAGES`` names; without one, of a small drawn room that is staged here. Its
session is processed before, so that nothing else runs while a page is timed. Wall times of a browser without a graphics
processor, in a fresh profile each: the median of `OPENED`.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.seeds import seeds
from benchmarks.whole.studio import CHROMIUM, OPTIONS, PATIENCE_LARGE_MS, drawn, truth
from processing.running.panorama_session import panorama_session

ROOT = Path(__file__).resolve().parents[2]
AXE = ROOT / "studio" / "web" / "node_modules" / "axe-core" / "axe.min.js"
PAGES, OPENED = ("index", "lab"), 3
WIDTHS_PX = (1440, 390)
"""A desktop's window and a phone's."""
VIOLATIONS = "async () => (await axe.run()).violations.length"
PAINTED = """() => new Promise((done) => new PerformanceObserver((list) => done(list.getEntries()[0].startTime))
  .observe({ type: "paint", buffered: true }))"""


def run(*, quick: bool, seed: int) -> dict[str, Any]:
    from playwright.sync_api import sync_playwright

    metrics: dict[str, float] = {}
    given = os.environ.get("DAYLIT_BENCH_PAGES")
    with tempfile.TemporaryDirectory(prefix="daylit-pages-") as place, sync_playwright() as started:
        folder = (Path(given) if given else staged(Path(place), seed)) / "stages" / "report"
        for name in PAGES:
            page = folder / f"{name}.html"
            metrics[f"{name}_mb"] = round(page.stat().st_size / 1e6, 3)
            found = [opened(started, page, width) for width in WIDTHS_PX for _ in range(1 if quick else OPENED)]
            paints, violations, asked, wide = zip(*found, strict=True)
            metrics[f"{name}_first_paint_s"] = round(float(np.median(paints)) / 1e3, 3)
            metrics |= {f"{name}_axe": max(violations), f"{name}_asked": max(asked), f"{name}_too_wide_px": max(wide)}
    return {
        "metrics": metrics,
        "units": {f"{name}_{key}": "" for name in PAGES for key in ("axe", "asked")}
        | {f"{name}_too_wide_px": "px" for name in PAGES},
        "notes": [
            f"session: {'given' if given else 'a drawn room of 512 x 256 pixels, in draft quality'}",
            "asked: requests of the net; too_wide: by which a page is wider than the window, at 1440 and 390 pixels",
        ],
    }


def staged(folder: Path, seed: int) -> Path:
    """A session of a drawn room, processed to its report."""
    rgb = drawn(truth(*seeds("test", 1, seed)))
    Image.fromarray((255 * np.clip(rgb / 100, 0, 1) ** (1 / 2.2)).astype(np.uint8)).save(folder / "room.png")
    session = panorama_session(folder / "room.png", folder)
    command = [sys.executable, "-m", "daylit", "process", str(session), "--set", "bedroom", "--quality", "draft"]
    command += ["--alternatives", "1"]
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONPATH": path})
    return session


def opened(started: Any, page: Path, width_px: int) -> tuple[float, int, int, int]:
    """First paint (ms), violations that axe finds, requests of the net, and pixels wider than the window."""
    browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE_LARGE_MS)
    tab = browser.new_context(viewport={"width": width_px, "height": 844}, reduced_motion="reduce").new_page()
    tab.set_default_timeout(PATIENCE_LARGE_MS)
    asked: list[str] = []
    tab.on("request", lambda one: None if one.url.startswith(("file:", "data:", "blob:")) else asked.append(one.url))
    tab.goto(page.as_uri())
    paint_ms = float(tab.evaluate(PAINTED))
    tab.evaluate(AXE.read_text("utf-8"))
    violations = int(tab.evaluate(VIOLATIONS))
    wider = int(tab.evaluate("() => document.documentElement.scrollWidth - innerWidth"))
    browser.close()
    return paint_ms, violations, len(asked), max(0, wider)


HIGH_PX = 1600
SHRINK = 2


def picture(session: Path, into: Path) -> None:
    """Write what desktop and phone show first of both pages, side by side: report-index.jpg, report-lab.jpg."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=OPTIONS, timeout=PATIENCE_LARGE_MS)
        for name in PAGES:
            shots = []
            for width in WIDTHS_PX:
                tab = browser.new_page(viewport={"width": width, "height": HIGH_PX})
                tab.goto((session / "stages" / "report" / f"{name}.html").as_uri(), timeout=PATIENCE_LARGE_MS)
                tab.wait_for_timeout(3000)
                shots.append(Image.open(io.BytesIO(tab.screenshot(timeout=PATIENCE_LARGE_MS))).convert("RGB"))
                tab.close()
            sheet = Image.new("RGB", (sum(WIDTHS_PX) + 40, HIGH_PX), "white")
            for shot, left in zip(shots, (0, WIDTHS_PX[0] + 40), strict=True):
                sheet.paste(shot, (left, 0))
            small = sheet.resize((sheet.width // SHRINK, sheet.height // SHRINK), Image.Resampling.LANCZOS)
            small.save(into / f"report-{name}.jpg", quality=80, optimize=True)
        browser.close()


if __name__ == "__main__":
    picture(Path(sys.argv[1]), Path(sys.argv[2]))
