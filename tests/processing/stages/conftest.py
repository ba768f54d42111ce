"""What stages do with equal pictures is done once."""

from tests.once import anew, each_pure_once

__all__ = ["anew", "each_pure_once"]
