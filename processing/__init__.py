"""Offline: from a session to a staged room."""
