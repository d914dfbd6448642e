"""Templates to decks, decks to data, meshes to files and back."""
