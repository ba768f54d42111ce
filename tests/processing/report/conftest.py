"""What reports show of equal results is drawn once."""

from tests.once import anew, each_pure_once

__all__ = ["anew", "each_pure_once"]
