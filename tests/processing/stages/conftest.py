"""What stages do with equal pictures is done once; imports share the processes that check frames."""

from tests.frame_workers import kept_workers
from tests.once import anew, each_pure_once

__all__ = ["anew", "each_pure_once", "kept_workers"]
