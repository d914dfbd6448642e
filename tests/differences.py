"""Gradients by differences, for what is tested without one of its own."""

import numpy as np

from fingerfit.fit.objective import Objective


def by_differences(score, width=1e-5):
    """A score with a gradient by central differences."""

    def gradient(at):
        steps = np.eye(len(at)) * width
        return np.array([(score(at + step) - score(at - step)) / (2 * width) for step in steps])

    return Objective(score, gradient)
