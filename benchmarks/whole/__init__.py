"""Benchmarks of the whole: capture, hostile files, batches, and a session from end to end."""
