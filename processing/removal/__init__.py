"""The room, emptied: what is to be removed, and what is put in its place."""
