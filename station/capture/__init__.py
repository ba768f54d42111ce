"""A capture from preflight to manifest."""
