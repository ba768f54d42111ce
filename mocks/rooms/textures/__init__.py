"""Generated patterns of surfaces."""
