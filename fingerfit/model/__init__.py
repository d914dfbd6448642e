"""What is assumed: parameters and their guesses, effects and the catalogue of them."""
