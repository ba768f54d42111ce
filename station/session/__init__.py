"""The session on disk: manifest, journal, frames, recovery, verification."""
