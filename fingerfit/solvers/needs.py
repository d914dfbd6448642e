"""What a deck needs of a solver, in words that adapters declare, and the refusal of what one lacks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.content import Deck
from fingerfit.mesh.mesh import Mesh
from fingerfit.solvers.contract import Capabilities

FEATURES = frozenset(
    {
        "*AMPLITUDE",
        "*ANISOTROPIC HYPERELASTIC",
        "*CONTACT PAIR",
        "*DLOAD",
        "*ELASTIC",
        "*ELEMENT twice in the plane",
        "*EQUATION",
        "*EXPANSION",
        "*FRICTION",
        "*FRICTION, ROUGH",
        "*HYPERELASTIC, MARLOW",
        "*HYPERELASTIC, MOONEY-RIVLIN",
        "*HYPERELASTIC, N=2 or more",
        "*HYPERELASTIC, NEO HOOKE",
        "*HYPERELASTIC at temperatures",
        "*HYPERELASTIC, OGDEN",
        "*HYPERELASTIC, REDUCED POLYNOMIAL, N=4 or more",
        "*HYPERELASTIC, YEOH",
        "*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN",
        "*INITIAL CONDITIONS, TYPE=STRESS",
        "*INSTANCE",
        "*RIGID BODY",
        "*RIGID BODY of rigid elements",
        "*SPRING",
        "*SPRING, NONLINEAR",
        "*STATIC, LONG TERM",
        "*STEP without NLGEOM",
        "*SURFACE, TYPE=CYLINDER",
        "*SURFACE, TYPE=REVOLUTION",
        "*SURFACE, TYPE=SEGMENTS",
        "*SURFACE BEHAVIOR, NO SEPARATION",
        "*TIE",
        "*VISCO",
        "*VISCOELASTIC",
    }
)
"""All that a deck may need beside elements and control; `Capabilities.features` are some of them."""
_ENERGIES = {
    "Elastic": "*ELASTIC",
    "Holzapfel": "*ANISOTROPIC HYPERELASTIC",
    "Marlow": "*HYPERELASTIC, MARLOW",
    "MooneyRivlin": "*HYPERELASTIC, MOONEY-RIVLIN",
    "NeoHooke": "*HYPERELASTIC, NEO HOOKE",
    "Ogden": "*HYPERELASTIC, OGDEN",
    "Yeoh": "*HYPERELASTIC, YEOH",
}


def needs(deck: Deck) -> set[str]:
    """Features that a deck needs, some of `FEATURES`."""
    found = {feature for feature, there in _model(deck) if there}
    for section in deck.sections:
        found |= set(_material(deck.materials[section.material]))
    return found


def require_sets(deck: Deck, path: Path, *names: str) -> None:
    """Refuse a deck without node sets that are read back; INDENTER is one node.

    Raises
    ------
    InputError
        Where the deck has no such set.
    """
    for name in names:
        nodes = deck.mesh.node_sets.get(name)
        if nodes is None or (name == "INDENTER" and len(nodes) != 1):
            raise InputError(path, "*NSET", f"no node set {name}", "the base's nodes and the indenter's reference node")


def _model(deck: Deck) -> Iterator[tuple[str, Any]]:
    yield "*CONTACT PAIR", deck.contacts
    yield "*ELEMENT twice in the plane", deck.mesh.dim == 2 and _doubled(deck.mesh)
    yield "*EQUATION", deck.equations
    yield "*EXPANSION", deck.expansion
    yield "*HYPERELASTIC at temperatures", deck.warmed
    yield "*INITIAL CONDITIONS, TYPE=PLASTIC STRAIN", deck.strain
    yield "*INITIAL CONDITIONS, TYPE=STRESS", deck.stress
    yield "*INSTANCE", any(scope for scope, _ in deck.labels)
    yield "*RIGID BODY", deck.rigid
    yield "*RIGID BODY of rigid elements", any(surface.facets for surface in deck.surfaces.values())
    yield "*SPRING", deck.springs
    yield "*SPRING, NONLINEAR", any(spring.table for spring in deck.springs)
    yield "*TIE", deck.ties
    for body in deck.rigid:
        if body.surface:
            yield f"*SURFACE, TYPE={deck.surfaces[body.surface].kind}", True
    for law in deck.laws.values():
        yield "*FRICTION", law.friction
        yield "*FRICTION, ROUGH", law.rough
        yield "*SURFACE BEHAVIOR, NO SEPARATION", not law.separates
    for step in deck.steps:
        yield "*AMPLITUDE", step.curve
        yield "*DLOAD", step.pressure
        yield "*STATIC, LONG TERM", step.relaxed
        yield "*STEP without NLGEOM", not step.finite
        yield "*VISCO", step.viscous


def _doubled(mesh: Mesh) -> bool:
    """Whether two elements have the same nodes."""
    return any(len(np.unique(block.nodes, axis=0)) < len(block.nodes) for block in mesh.blocks)


def _material(material: Any) -> Iterator[str]:
    kind = type(material).__name__
    yield _ENERGIES[kind]
    if kind == "Ogden" and len(material.mu) > 1:
        yield "*HYPERELASTIC, N=2 or more"
    if kind == "Yeoh" and len(material.c) > 3:
        yield "*HYPERELASTIC, REDUCED POLYNOMIAL, N=4 or more"
    if material.prony is not None and material.prony.g:
        yield "*VISCOELASTIC"


def refuse_lacking(deck: Deck, path: Path, name: str, capabilities: Capabilities) -> None:
    """Refuse a deck that needs more than a solver declares.

    Parameters
    ----------
    deck : Deck
    path : Path
        For the message.
    name : str
        Of the solver.
    capabilities : Capabilities

    Raises
    ------
    InputError
        For the first element, control or feature that it lacks.
    """
    for element in sorted({block.element for block in deck.mesh.blocks} - capabilities.elements):
        expected = f"for solver {name} one of " + ", ".join(sorted(capabilities.elements))
        raise InputError(path, "*ELEMENT", element, expected)
    for keyword, control, given in (
        ("*CLOAD", "force", [step.force for step in deck.steps]),
        ("*BOUNDARY", "displacement", [step.displacement for step in deck.steps]),
    ):
        if control not in capabilities.control and any(any(values.values()) for values in given):
            raise InputError(
                path,
                keyword,
                f"{control} control",
                f"for solver {name} {' or '.join(sorted(capabilities.control))} control",
            )
    for feature in sorted(needs(deck) - capabilities.features):
        keyword, _, option = feature.partition(" without ")
        keyword = keyword.partition(",")[0].partition(" of ")[0].partition(" twice ")[0]
        alike = {f for f in capabilities.features if f.partition(",")[0] == keyword}
        if feature in _ENERGIES.values():
            alike = set(_ENERGIES.values()) & capabilities.features
        expected = "; ".join(sorted(alike)) if alike else "a deck without it"
        raise InputError(path, keyword, f"no {option}" if option else feature, f"for solver {name} {expected}")
