"""``make torture``: the long fault-injection runs; writes the figures into docs/measurements/reliability.md."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "measurements" / "reliability.md"
START, END = "<!-- figures: written by make torture -->", "<!-- end of figures -->"


def main() -> int:
    """Run tests/torture in its long form and update the page; returns pytest's exit code."""
    start_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        ledger = Path(folder) / "ledger.jsonl"
        environment = {**os.environ, "DAYLIT_TORTURE": "1", "DAYLIT_LEDGER": str(ledger)}
        command = [sys.executable, "-m", "pytest", "tests/torture", "-q", "-n", "2", "--timeout", "3600"]
        code = subprocess.run([*command, *sys.argv[1:]], cwd=ROOT, env=environment, check=False).returncode
        rows = [json.loads(line) for line in ledger.read_text().splitlines()] if ledger.exists() else []
    _write(rows, time.monotonic() - start_s)
    return code


def _write(rows: list[dict[str, object]], seconds: float) -> None:
    table = [
        "| campaign | injected | observed | lost or wrong | seconds | seed | notes |",
        "| --- | --: | --: | --: | --: | --: | --- |",
    ]
    for row in sorted(rows, key=lambda r: str(r["campaign"])):
        figures = f"| {row['campaign']} | {row['injected']:,} | {row['observed']:,} | **{row['lost']}** "
        table.append(f"{figures}| {float(str(row['seconds'])):.0f} | {row['seed']} | {row.get('notes', '')} |")
    text = PAGE.read_text("utf-8")
    before, after = text.split(START)[0], text.split(END)[1]
    middle = "\n".join(
        [START, "", f"Last run: {seconds / 60:.0f} minutes on {os.cpu_count()} cores.", "", *table, "", END]
    )
    PAGE.write_text(before + middle + after, "utf-8")


if __name__ == "__main__":
    sys.exit(main())
