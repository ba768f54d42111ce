"""Where furniture stands in a generated room, and a check."""
