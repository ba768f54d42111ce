"""Frames: their headers, checks and import."""
