"""A reference mesh brought to a subject's volume."""
