"""Floor plans: outline, openings, fixtures, and their check."""
