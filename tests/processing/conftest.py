"""Few rays, for tests that ask for them."""

from tests.few_rays import few_rays

__all__ = ["few_rays"]
