"""Where real pictures and plans lie: beside the checkout, or where ``DAYLIT_SHARED`` says; they are no part of it."""

from __future__ import annotations

import os
from pathlib import Path

DATA = Path(os.environ.get("DAYLIT_SHARED", Path(__file__).resolve().parents[2] / "shared")) / "data"
