"""The planes of a room on the sphere: masks, depth and normals of a panorama, and rectified textures there and back."""
