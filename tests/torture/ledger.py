"""The figures of the torture runs: one JSON line a campaign, appended to the file named by DAYLIT_LEDGER."""

from __future__ import annotations

import json
import os
from pathlib import Path


def record(
    campaign: str, *, injected: int, observed: int, lost: int, seconds: float, seed: int, notes: str = ""
) -> None:
    """Append the figures of a campaign; without DAYLIT_LEDGER nothing is written."""
    ledger = os.environ.get("DAYLIT_LEDGER")
    if not ledger:
        return
    line = {
        "campaign": campaign,
        "injected": injected,
        "observed": observed,
        "lost": lost,
        "seconds": round(seconds, 2),
        "seed": seed,
        "notes": notes,
    }
    with Path(ledger).open("a", encoding="utf-8") as file:
        file.write(json.dumps(line) + "\n")
