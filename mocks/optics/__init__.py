"""From radiance to a frame: lens, sensor, response, noise, JPEG."""
