"""Commands that run in the tests' own process share processes that check frames, and what follows from equal ones."""

from tests.frame_workers import kept_workers
from tests.once import each_pure_once

__all__ = ["each_pure_once", "kept_workers"]
