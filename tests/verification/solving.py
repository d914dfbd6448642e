"""Solving small problems without a deck."""

import numpy as np

from fingerfit.fem.assembly import Body
from fingerfit.fem.elements import ELEMENTS, rule
from fingerfit.fem.newton import Load, Newton
from fingerfit.fem.system import System
from fingerfit.fem.volume import AveragedVolume
from fingerfit.material.spread import spread


def parts_of(element, points, nodes, material, thickness=1.0):
    """Bodies and terms of elements that are all of one material."""
    gauss = len(rule(element)[1])
    everywhere = spread([material], [len(nodes) * gauss])
    body = Body(element, points, nodes, everywhere, np.full(len(nodes), thickness))
    terms = [AveragedVolume(body, np.zeros(len(nodes), int), [material])] if ELEMENTS[element].nodal else []
    return body, terms


def solve(body, terms, size, fixed, force=None, given=None, steps=1, ties=None):
    """Displacements at the end of a path; `fixed` are degrees of freedom, `given` their values."""
    prescribed = np.zeros(size, dtype=bool)
    prescribed[fixed] = True
    load = Load(np.zeros(size) if given is None else given, np.zeros(size) if force is None else force)
    newton = Newton(System([body] if body else [], size, prescribed, ties or {}, terms))
    with np.errstate(all="ignore"):
        arrived, _ = newton.advance(load, 1.0 / steps)
    assert arrived
    return newton
