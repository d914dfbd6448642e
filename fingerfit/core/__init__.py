"""Errors, files, YAML, units, processes: knows nothing of mechanics."""
