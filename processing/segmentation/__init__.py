"""What each pixel of a panorama shows, and where the room's boundaries run: evidence for room and removal."""
