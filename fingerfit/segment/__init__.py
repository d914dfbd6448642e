"""Meshes of segmentations: labels, the surfaces between them, and elements within."""
