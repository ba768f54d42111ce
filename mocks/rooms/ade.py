"""Numbers of the ADE20K classes (150, counted from 0) that simulated rooms hold."""

from __future__ import annotations

ADE20K = {
    "wall": 0, "building": 1, "sky": 2, "floor": 3, "tree": 4, "ceiling": 5, "bed": 7, "windowpane": 8, "grass": 9,
    "cabinet": 10, "door": 14, "table": 15, "plant": 17, "curtain": 18, "chair": 19, "painting": 22, "sofa": 23,
    "shelf": 24, "rug": 28, "armchair": 30, "desk": 33, "wardrobe": 35, "lamp": 36, "cushion": 39, "box": 41,
    "chest of drawers": 44, "pillow": 57, "bookcase": 62, "blind": 63, "coffee table": 64, "book": 67,
    "bench": 69, "computer": 74, "swivel chair": 75, "towel": 81, "light": 82, "chandelier": 85, "television": 89,
    "ottoman": 97, "bottle": 98, "poster": 100, "plaything": 108, "stool": 110, "basket": 112, "bag": 115,
    "ball": 119, "pot": 125, "blanket": 131, "vase": 135, "tray": 137, "ashcan": 138, "plate": 142, "monitor": 143,
    "radiator": 146, "glass": 147, "clock": 148,
}  # fmt: skip
"""By name; equipment (tripod, meter board) has no class and is -1."""

NO_CLASS = -1
