"""Commands that run in the tests' own process share the processes that check frames."""

from tests.frame_workers import kept_workers

__all__ = ["kept_workers"]
