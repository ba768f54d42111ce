"""The room of a session in another light, and from other places."""
