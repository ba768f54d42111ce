"""A simulated USB bus below the drivers."""
