"""The outdoor picture: lens, image circle, ND filter, north, sun."""
