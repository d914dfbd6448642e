"""What was understood of a study before anything runs."""
