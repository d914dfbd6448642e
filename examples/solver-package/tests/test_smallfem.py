"""The suite that fingerfit ships for adapters."""

from smallfem.adapter import SmallFem

from fingerfit.testing.solver import SolverConformance


class TestSmallFem(SolverConformance):
    tolerance = 1e-6

    def make(self):
        return SmallFem()
