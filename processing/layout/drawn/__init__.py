"""Plans and pictures of arrangements."""
