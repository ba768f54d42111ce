"""What is made of equal frames is made once; imports share the processes that check frames."""

from tests.frame_workers import kept_workers
from tests.once import each_pure_once

__all__ = ["each_pure_once", "kept_workers"]
