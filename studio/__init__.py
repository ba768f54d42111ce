"""The studio: sessions seen, corrected and furnished by hand in a browser. It uses the public API and the runner."""
