"""Suites that adapters of other packages subclass in their tests."""
