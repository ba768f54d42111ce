"""Pictures: the two picture types, files in and out (OpenEXR, Radiance, JPEG, PNG), frames and masks.

``.exr`` keeps everything and is what stages hand on; ``.hdr`` is for Radiance's tools; JPEG and PNG are for viewing.
"""
