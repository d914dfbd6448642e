"""The reference finger and other bodies from a few lengths."""
