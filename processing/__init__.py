"""Offline: from a session to a staged room (not built yet: the issues after the station bring it)."""
