"""What a calibrated panorama says of a room's light: illuminance, glare, luminance statistics."""
