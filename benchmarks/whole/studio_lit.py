"""How long one waits in the studio for the light of furniture that is dragged: in the page, by the mouse."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.light.relight import lights_of_seed, scene_of_seed
from benchmarks.whole.studio import PATIENCE_LARGE_MS, SIZE_PX, box_of, make_session, screen, truth, until
from processing.light.picture.render import render
from processing.light.scene.scene_file import write_scene
from processing.light.solver.irradiance import Effort
from processing.pictures.preview import write_mask
from processing.sphere import Equirectangular

ROWS = 512
"""Of the room in which furniture is dragged: what the preview shows at most."""
LOOK = Effort(texel_m=0.3, patch_samples=48, rows=64, pixel_samples=48, sun_samples=16, clean=False)
MOVES = 6
"""Of a piece that is dragged; the first is not counted."""


def session(folder: Path, number: int, *, quick: bool) -> Path:
    """A session of a generated room under a clear sky, furnished, in which furniture can be lit while it is dragged."""
    rows = SIZE_PX[1] if quick else ROWS
    scene, eye = scene_of_seed(number)
    scene = replace(scene, parts=(), outdoors=lights_of_seed(number, quick=True)[0])
    rgb = render(scene, Equirectangular(2 * rows, rows), eye, effort=LOOK).rgb
    made = make_session(folder, "lit", truth(number), truth(number), rows // SIZE_PX[1], rgb)
    (stages := made / "stages").joinpath("materials").mkdir()
    write_scene(stages / "materials" / "scene.npz", scene)
    (stages / "materials" / "materials.json").write_text('{"outdoors": "outdoor picture"}', "utf-8")
    shutil.copytree(stages / "calibrate", stages / "remove")
    shutil.copy(stages / "calibrate" / "indoor.exr", stages / "remove" / "empty.exr")
    write_mask(stages / "remove" / "filled.png", np.zeros(rgb.shape[:2], bool))
    return made


def relit(page: Any, session: str) -> tuple[float, float]:
    """Drag each piece of a room; return the median milliseconds until it is seen relit, and those of the slowest."""
    last = "document.querySelector('[data-part=lit]').dataset.seconds"
    screen(page, session, "furnish")
    until(page, f"() => {last}", limit_ms=PATIENCE_LARGE_MS)
    medians = []
    for piece in [mark.get_attribute("data-id") for mark in page.locator(".piece").all()]:
        waited_s = []
        box = box_of(page, f".piece[data-id={piece}]")
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        for step in range(1, MOVES + 1):
            page.evaluate(_WHEN_LIT)
            page.mouse.move(x + step % 3, y + step // 3)
            waited_s.append(float(page.evaluate("() => window.lit")))
        page.keyboard.press("Escape")
        page.mouse.up()
        medians.append(1000 * float(np.median(waited_s[1:])))
    return float(np.median(medians)), max(medians)


_WHEN_LIT = """() => {
  const said = document.querySelector("[data-part=lit]");
  window.lit = new Promise((done, fail) => {
    setTimeout(() => fail("no preview of the furniture that is dragged"), 60000);
    new MutationObserver(() => done(said.dataset.seconds)).observe(said, { attributeFilter: ["data-seconds"] });
  });
}"""
