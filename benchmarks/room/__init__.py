"""Benchmarks of room layout and of detection masks."""
