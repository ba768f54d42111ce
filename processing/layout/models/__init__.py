"""Furniture models from files."""
