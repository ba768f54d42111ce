"""Layout networks of others, as ONNX files that users bring: HorizonNet, LED2-Net and LGT-Net exports.

All take one picture [1, 3, 512, 1024], RGB from 0 to 1, upright, and do best with the walls straight ahead. They differ
in what they give; the kind is recognised by the outputs' shapes and checked when the file is loaded:

========== ============================================ ==================================================
kind       outputs                                      meaning
========== ============================================ ==================================================
HorizonNet bon [1, 2, 1024], cor [1, 1, 1024]           boundaries as angles (up, down), corners as logits
LED2-Net   [1, 2, 1024]                                 latitudes (up, down)
LGT-Net    depth [1, 256], ratio [1, 1]                 distance over camera height; ceiling over camera to
                                                        camera over floor
========== ============================================ ==================================================

No weights are shipped: those known are trained on data that allow no products, or only non-commercial ones.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from processing.errors import LayoutNetworkError, ParameterError
from processing.pictures.images import LuminanceImage, RelativeImage
from processing.pictures.preview import preview_rgb8
from processing.segmentation.evidence import BoundaryEvidence
from processing.segmentation.segmenters import open_session
from processing.sphere import Equirectangular

Kind = Literal["HorizonNet", "LED2-Net", "LGT-Net"]

WIDTH_PX, HEIGHT_PX = 1024, 512
SIGMA_RAD = math.radians(1.0)  # taken for all columns: none of these networks states its own
LEAST_LATITUDE_RAD = 0.01  # chosen: keeps distances finite
CONTRACTS = "HorizonNet gives [1,2,1024] and [1,1,1024], LED2-Net [1,2,1024], LGT-Net [1,256] and [1,1]"


@dataclass(frozen=True)
class LayoutNetwork:
    """A loaded network."""

    kind: Kind
    input_name: str
    outputs: tuple[str, ...]
    """In the order of the kind's table row."""
    session: Any
    name: str

    @property
    def columns(self) -> int:
        """Return how many columns its answers have."""
        return 256 if self.kind == "LGT-Net" else WIDTH_PX


def load_layout_network(path: Path) -> LayoutNetwork:
    """Load an ONNX file and recognise its kind by its inputs and outputs.

    Raises `LayoutNetworkError`: not an ONNX file, or inputs and outputs of no known kind; says what was found.
    """
    session = open_session(path, lambda what: LayoutNetworkError(what, where=str(path)))
    inputs, outputs = session.get_inputs(), {o.name: tuple(o.shape) for o in session.get_outputs()}
    if len(inputs) != 1 or not _fits(tuple(inputs[0].shape), (1, 3, HEIGHT_PX, WIDTH_PX)):
        found = ", ".join(f"{i.name} {i.shape}" for i in inputs)
        raise LayoutNetworkError(f"takes {found}, not one picture [1, 3, 512, 1024]", where=str(path))
    kind, names = _kind(outputs, path)
    return LayoutNetwork(kind, inputs[0].name, names, session, path.name)


def layout_boundary(
    image: RelativeImage | LuminanceImage, network: LayoutNetwork, *, turn_rad: float = 0.0
) -> BoundaryEvidence:
    """Return a network's boundaries on an upright panorama.

    ``turn_rad``: the walls' azimuth (`processing.room.level.find_upright`); the picture is turned by it, to the next
    column of the answer, and the answer is turned back by just that.

    Raises `ParameterError`: the picture is not equirectangular; `LayoutNetworkError`: the network fails on the picture,
    or gives values that no boundary has.
    """
    if not isinstance(image.geometry, Equirectangular) or image.geometry.yaw_rad:
        raise ParameterError("the picture is not equirectangular with longitude 0 at its centre")
    shown = cv2.resize(preview_rgb8(image.rgb), (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA)
    turn = round(turn_rad / (2 * math.pi) * network.columns)
    ahead = np.roll(shown, -turn * (WIDTH_PX // network.columns), axis=1)
    picture = ahead.transpose(2, 0, 1)[None].astype(np.float32) / np.float32(255)
    try:
        found = network.session.run(list(network.outputs), {network.input_name: np.ascontiguousarray(picture)})
    except Exception as exc:
        raise LayoutNetworkError(f"fails on the picture: {str(exc)[:200]}", where=network.name) from exc
    ceiling, floor, corner = _read(network, [np.asarray(f, np.float64) for f in found])
    return BoundaryEvidence(
        ceiling_rad=np.roll(ceiling, turn),
        floor_rad=np.roll(floor, turn),
        ceiling_sigma_rad=np.full(len(ceiling), SIGMA_RAD),
        floor_sigma_rad=np.full(len(floor), SIGMA_RAD),
        corner=np.roll(corner, turn).astype(np.float32),
    )


def _kind(outputs: dict[str, tuple[Any, ...]], path: Path) -> tuple[Kind, tuple[str, ...]]:
    def named(shape: tuple[int, ...]) -> list[str]:
        return [name for name, found in outputs.items() if _fits(found, shape)]

    boundary, corner = named((1, 2, WIDTH_PX)), named((1, 1, WIDTH_PX))
    depth, ratio = named((1, 256)), named((1, 1))
    if len(boundary) == 1 and len(corner) == 1:
        return "HorizonNet", (boundary[0], corner[0])
    if len(depth) == 1 and len(ratio) == 1 and depth != ratio:
        return "LGT-Net", (depth[0], ratio[0])
    if len(boundary) == 1 and len(outputs) == 1:
        return "LED2-Net", (boundary[0],)
    found = ", ".join(f"{name} {list(shape)}" for name, shape in outputs.items())
    raise LayoutNetworkError(f"gives {found}", where=str(path), likely="another network", advice=CONTRACTS)


def _fits(found: tuple[Any, ...], wanted: tuple[int, ...]) -> bool:
    """Return whether a shape is the one wanted; names of free sizes fit the number of pictures only."""
    if len(found) != len(wanted):
        return False
    first = isinstance(found[0], str) or found[0] in (None, wanted[0])
    return first and tuple(found[1:]) == wanted[1:]


def _read(network: LayoutNetwork, found: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return latitudes of ceiling and floor, and corner probabilities, as far as the network gives any."""
    if not all(np.isfinite(f).all() for f in found):
        raise LayoutNetworkError("gives values that are not finite", where=network.name)
    if network.kind == "LGT-Net":
        depth, ratio = found[0].reshape(-1), float(found[1].reshape(-1)[0])
        if depth.min() <= 0 or not 0.05 < ratio < 20:
            raise LayoutNetworkError("gives distances or a ratio of heights below 0", where=network.name)
        return np.arctan(ratio / depth), -np.arctan(1 / depth), np.zeros(len(depth))
    ceiling, floor = found[0].reshape(2, -1)
    # HorizonNet counts angles downwards, LED2-Net upwards; the ceiling is the first either way.
    up = 1.0 if np.median(ceiling) > 0 else -1.0
    ceiling, floor = up * ceiling, up * floor
    if np.median(floor) >= 0 or np.abs(np.stack([ceiling, floor])).max() > math.pi / 2 + 1e-3:
        text = "gives boundaries that are not angles above and below the horizon"
        likely = "the export ends before or after the network's own output"
        raise LayoutNetworkError(text, where=network.name, likely=likely)
    corner = 1 / (1 + np.exp(-np.clip(found[1].reshape(-1), -50, 50))) if len(found) == 2 else np.zeros(len(floor))
    return np.maximum(ceiling, LEAST_LATITUDE_RAD), np.minimum(floor, -LEAST_LATITUDE_RAD), corner
