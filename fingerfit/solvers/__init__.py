"""The adapter contract and the adapters: built-in, CalculiX, ABAQUS; what decks need and whether answers are whole."""
