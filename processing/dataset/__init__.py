"""Processed sessions as a data set: index, checksums, licence, splits, Croissant metadata."""
