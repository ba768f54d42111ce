"""Benchmarks of calibration: response, merge, photometry, resampling of the sphere."""
