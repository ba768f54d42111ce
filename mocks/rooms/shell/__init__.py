"""Walls, windows, doors, fixtures and lamps as meshes."""
