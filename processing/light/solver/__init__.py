"""The light solver."""
