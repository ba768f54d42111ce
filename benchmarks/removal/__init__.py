"""Benchmarks of furniture removal, and its rivals."""
