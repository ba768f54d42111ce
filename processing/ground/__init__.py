"""The shared ground: what several rooms of the house need. It imports none of them."""
