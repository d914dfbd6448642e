"""Conformance suites that adapters of other packages subclass in their own tests."""
