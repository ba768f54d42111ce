"""Benchmarks of furniture arrangement, and its rivals."""
