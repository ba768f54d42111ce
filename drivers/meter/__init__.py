"""Luminance meters on a serial line: their dialects, dialogue and probe."""
