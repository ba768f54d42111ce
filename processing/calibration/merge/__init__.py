"""A bracket becomes one relative HDR picture with an uncertainty per pixel."""
