"""The light of a generated room: traced, baked and denoised."""
