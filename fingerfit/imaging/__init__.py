"""Pictures: reading, preprocessing, warp, similarity, registration, noise, sections."""
