"""The examples share the processes that check frames."""

from tests.frame_workers import kept_workers

__all__ = ["kept_workers"]
