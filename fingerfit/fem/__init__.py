"""The built-in solver's numerics: assembly, constraints, contact, Newton; no decks, no files."""
