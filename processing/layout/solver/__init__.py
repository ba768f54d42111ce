"""The search for arrangements that break no rule."""
