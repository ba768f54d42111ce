"""What is made of equal frames is made once."""

from tests.once import each_pure_once

__all__ = ["each_pure_once"]
