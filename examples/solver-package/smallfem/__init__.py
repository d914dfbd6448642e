"""A small finite-element program as a solver of fingerfit."""
