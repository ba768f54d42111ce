"""The scene to light: surfaces, albedo, windows, sky."""
