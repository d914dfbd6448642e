"""Meshes: nodes, elements and their shapes, faces, sets; blocks and tetrahedra, and whether a mesh is sound."""
