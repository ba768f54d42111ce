"""Benchmarks of light: rendering, relighting, albedo, and the analytic truth."""
