"""How wide the cells of equal pictures are is worked out once."""

from tests.once import each_pure_once

__all__ = ["each_pure_once"]
