"""What is made of equal frames, whatever files they are imported from, is made once, checked by the same processes."""

from tests.frame_workers import kept_workers
from tests.once import each_pure_once

__all__ = ["each_pure_once", "kept_workers"]
