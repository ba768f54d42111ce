"""Light figures: illuminance, glare and luminance statistics."""
