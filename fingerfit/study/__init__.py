"""What was measured: the study as its files say it, and the measurements as arrays."""
