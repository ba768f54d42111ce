"""Captures share the processes that check their frames."""

from tests.frame_workers import kept_workers

__all__ = ["kept_workers"]
