"""The sky and the land outside the windows."""
