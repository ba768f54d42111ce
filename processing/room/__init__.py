"""The room as planes: its model, and how it is estimated from a panorama."""
