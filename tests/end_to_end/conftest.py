"""Commands in the tests' own process share processes that check frames, and what follows from equal ones; few rays."""

from tests.few_rays import few_rays
from tests.frame_workers import kept_workers
from tests.once import each_pure_once

__all__ = ["each_pure_once", "few_rays", "kept_workers"]
