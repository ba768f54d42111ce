"""Results in the formats of others: JPEG with panorama tags, labels, glTF."""
