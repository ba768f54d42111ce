"""A session under another sky or at another time, and seen from another place in the room."""
