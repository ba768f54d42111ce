"""Furniture arrangements: a room's plan and a list of items in, ranked arrangements that break no rule out."""
