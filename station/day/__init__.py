"""A day on site: brackets by the hour, a queue of rooms, and what is watched between them."""
