"""Energies, stresses and tangents by stretches."""
