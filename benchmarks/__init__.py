"""Benchmarks: time, memory and error of each capability, side by side with rivals; one file a capability."""
