"""A process for one session: `daylit` itself, which dies with the worker that began it.

``python -m processing.batch.child process SESSION --json``. What a session can do to its process (run out of memory,
crash in a library, hang) so never reaches the worker; and a worker that is killed leaves no process behind that would
hold the session's lock.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def die_with_parent(parent: int) -> None:
    """Ask Linux to kill this process when its parent ends; elsewhere nothing is done."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it ended before it could be asked
        os.kill(os.getpid(), signal.SIGKILL)


def main(argv: list[str]) -> int:
    """Run `daylit` with these arguments, the first of them the parent's process id."""
    die_with_parent(int(argv[0]))
    import daylit

    return daylit.main(argv[1:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
