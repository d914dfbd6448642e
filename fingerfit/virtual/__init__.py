"""Virtual experiments: a truth, its simulation, and pictures of it."""
