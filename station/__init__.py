"""On site: from instruments to a complete, verified session on disk."""
