"""Offline: from a session to a staged room."""

import os

# Read by Numba when it is imported: kernels are kept by the content of their source (`processing.ground.kernels`).
os.environ.setdefault(
    "NUMBA_CACHE_LOCATOR_CLASSES",
    "processing.ground.kernels.ByContent,UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator",
)
