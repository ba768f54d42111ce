"""Pictures in and out of files; each kind of file has a module of its own (docs/formats.md)."""

from __future__ import annotations

from processing.exr_files import read_exr, read_exr_rgb, write_exr

__all__ = ["read_exr", "read_exr_rgb", "write_exr"]
