"""The camera's response curve, noise and shutter times."""
