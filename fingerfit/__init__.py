"""Material constants of soft layered bodies from pictures before and during compression."""

__version__ = "0.1.0"
