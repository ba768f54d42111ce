"""Responses of few patches, for tests that ask for it."""

from tests.once import few_patches

__all__ = ["few_patches"]
