"""Many sessions: each a task of its own on a Dask cluster, local or elsewhere."""
