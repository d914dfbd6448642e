"""Solving small problems, without a deck or from one that is also written back."""

import numpy as np

from fingerfit.deck.reader import read_deck
from fingerfit.deck.write import format_deck
from fingerfit.fem.assembly import Body
from fingerfit.fem.newton import Load
from fingerfit.fem.path import LoadPath
from fingerfit.fem.system import System
from fingerfit.fem.volume import AveragedVolume
from fingerfit.material.elastic import Elastic
from fingerfit.material.holzapfel import Holzapfel
from fingerfit.material.marlow import Marlow
from fingerfit.material.mooney_rivlin import MooneyRivlin
from fingerfit.material.neo_hooke import NeoHooke
from fingerfit.material.ogden import Ogden
from fingerfit.material.prony import Prony
from fingerfit.material.spread import spread
from fingerfit.material.yeoh import Yeoh
from fingerfit.mesh.elements import ELEMENTS, rule
from fingerfit.solvers.analysis import run_steps

AXIS = (0.6, 0.48, 0.64)
MATERIALS = {
    "ogden3": Ogden((0.02, 0.01, -0.005), (1.4, -2.0, 3.0), (0.8, 5.0, 2.0)),
    "neo_hooke": NeoHooke(0.02, (0.8,)),
    "mooney_rivlin": MooneyRivlin(0.02, 0.008, (0.8,)),
    "yeoh": Yeoh((0.02, 0.004, 0.001), (0.8, 5.0, 3.0)),
    "reduced6": Yeoh((0.02, 0.004, 0.001, 5e-4, 2e-4, 1e-4), (0.8,)),
    # softens, then stiffens; less far than a test stretches it
    "marlow": Marlow((0.1, 0.2, 0.4, 0.8), (0.011, 0.019, 0.03, 0.06), (0.8,)),
    "elastic": Elastic(0.1, 0.3),
    "hencky": Elastic(0.1, 0.3, Prony((0.0,), (1.0,))),
    "holzapfel": Holzapfel(0.02, 0.8, 0.05, 0.9, 0.1, (AXIS,)),
    "dispersed": Holzapfel(0.02, 0.8, 0.05, 0.9, 1 / 3, (AXIS,)),
}


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
    loading = LoadPath(System([body] if body else [], size, prescribed, ties or {}, terms))
    with np.errstate(all="ignore"):
        arrived, _ = loading.advance(load, 1.0 / steps)
    assert arrived
    return loading


def solve_deck(path):
    """A deck and its steps; what `fingerfit deck show` writes of it must have the same solution, and be stable."""
    deck = read_deck(path)
    steps = list(run_steps(deck, path))
    shown = path.with_name("shown.inp")
    shown.write_text(format_deck(deck))
    again = read_deck(shown)
    assert format_deck(again).splitlines()[-1] == "*END STEP"
    found = list(run_steps(again, shown))
    assert len(found) == len(steps)
    for ours, theirs in zip(found, steps, strict=True):
        assert ours.arrived == theirs.arrived
        scale = np.abs(theirs.displacement).max() + 1e-300
        assert np.abs(ours.displacement - theirs.displacement).max() <= 1e-9 * scale
    return deck, steps
