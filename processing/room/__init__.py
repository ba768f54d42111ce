"""The room as planes: its model, and how it is told from a panorama."""
