"""Hardware: links, protocols and one driver an instrument; imports nothing else of daylit."""
