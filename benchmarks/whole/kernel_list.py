"""``python -m benchmarks.whole.kernel_list SESSION PROFILE``: process a session that has no results yet, and write
down which kernels that took, for `processing.ground.kernels.load_kernels`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from processing.ground.kernels import write_list
from processing.running.requests import RunRequest
from processing.running.runner import process


def main(session: Path, profile: Path) -> int:
    process(session, RunRequest(options={"--calibration": profile}))
    write_list()
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
