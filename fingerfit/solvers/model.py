"""From a deck to elements, constraints and forces of the built-in solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.content import Deck, DeckStep, Rigid
from fingerfit.fem.assembly import Body
from fingerfit.fem.system import System
from fingerfit.material.spread import spread, structure_of, warmed
from fingerfit.mesh.elements import AXISYMMETRIC, ELEMENTS, from_corners, rule
from fingerfit.solvers.initial import initial_state, is_elastic


@dataclass(frozen=True)
class Element:
    """Where an element of a deck is: its type, nodes and section."""

    kind: str
    nodes: np.ndarray
    section: int


class Model:
    """What a deck describes, ready to be solved.

    Parameters
    ----------
    deck : Deck
    path : Path
        For messages.
    averaged : bool
        Whether linear quadrilaterals and bricks average the change of volume.

    Raises
    ------
    InputError
        For what does not fit together.
    """

    def __init__(self, deck: Deck, path: Path, averaged: bool = True) -> None:
        self.deck, self.path, self.dim = deck, path, deck.mesh.dim
        self.finite = deck.steps[0].finite
        self.nodal = deck.mesh.points.size
        self._extra: dict[tuple[int, int], int] = {}
        self.ties: dict[int, list[tuple[int, float]]] = {}
        self.rigid: list[Any] = []
        self.bodies: list[Any] = []
        self.terms: list[Any] = []
        self.pressures: list[tuple[Any, list[tuple[int, int]]]] = []
        self._begun = self.temperature_of(deck.temperature)
        self.temperature = self._begun
        self.expands: list[tuple[Any, Any, np.ndarray, np.ndarray]] = []
        self.warms: list[tuple[Any, Any, np.ndarray, np.ndarray]] = []
        self._section = self._sections()
        tied = self._settle_ties()
        self._add_rigid()
        self.size = self.nodal + len(self._extra)
        self._add_bodies(averaged)
        self._add_ties(tied)
        self._add_forces()

    def dof(self, node: int, axis: int) -> int:
        """Degree of freedom of a node and axis; -1 where there is none."""
        if axis < self.dim:
            return node * self.dim + axis
        return self._extra.get((node, axis), -1)

    @property
    def sticks(self) -> bool:
        """Whether something is held by friction or glue where it has come to touch: then the way there matters."""
        return any(not getattr(term, "slides", True) for term in self.terms)

    def system(self, prescribed: np.ndarray) -> System:
        """Equations with some displacements prescribed."""
        try:
            points = self.deck.mesh.points
            return System(self.bodies, self.size, prescribed, self.ties, self.terms, self.rigid, points)
        except ValueError as error:
            raise self._not_free(int(error.args[0])) from None

    def _not_free(self, dof: int) -> InputError:
        found = f"node {self._name(dof // self.dim)} is tied twice or prescribed"
        return InputError(self.path, "*EQUATION, *TIE or *RIGID BODY", found, "slaves that are free")

    def _name(self, node: int) -> str:
        if node >= len(self.deck.labels):
            return str(node + 1)
        scope, label = self.deck.labels[node]
        return f"{scope}.{label}" if scope else str(label)

    def _sections(self) -> np.ndarray:
        mesh = self.deck.mesh
        found = np.full(mesh.element_count, -1)
        for number, section in enumerate(self.deck.sections):
            found[mesh.element_sets[section.elset]] = number
        rigid = [element for body in self.deck.rigid for element in body.elements]
        found[rigid] = -2
        for body in self.deck.rigid:
            # also those between nodes of a rigid body are never deformed
            inside = np.zeros(len(mesh.points), dtype=bool)
            inside[[*body.nodes, body.reference]] = True
            found[np.concatenate([inside[block.nodes].all(axis=1) for block in mesh.blocks])] = -2
        if (found == -1).any():
            raise InputError(self.path, "*SOLID SECTION", "elements without section", "a section for every element")
        return found

    def material(self, section: int) -> Any:
        """Material of a section, its fibres in global directions."""
        given = self.deck.sections[section]
        material = self.deck.materials[given.material]
        if not self.finite and (not is_elastic(material) or material.prony is not None):
            raise InputError(self.path, "*STEP", "no NLGEOM", "NLGEOM: only *ELASTIC is for small strain")
        if hasattr(material, "directions") and given.orientation:
            local = self.deck.orientations[given.orientation]
            vectors = np.array(local.directions or material.directions) @ local.axes
            material = replace(material, directions=tuple(map(tuple, vectors.tolist())))
        return material

    @cached_property
    def materials(self) -> list[Any]:
        """Material of each element, in order; None without a section."""
        return [self._materials.get(n) for n in self._section.tolist()]

    @cached_property
    def _materials(self) -> dict[int, Any]:
        """By number of the section, of those that elements have."""
        return {n: self.material(n) for n in sorted(set(self._section.tolist())) if n >= 0}

    @cached_property
    def elements(self) -> list[Element]:
        """All elements in order."""
        blocks = self.deck.mesh.blocks
        kinds = (block.element for block in blocks for _ in block.nodes)
        nodes = (own for block in blocks for own in block.nodes)
        return [Element(*one) for one in zip(kinds, nodes, self._section.tolist(), strict=True)]

    def _add_bodies(self, averaged: bool) -> None:
        deck, first = self.deck, 0
        kinds = {n: structure_of(material) for n, material in self._materials.items()}
        for block in deck.mesh.blocks:
            section = self._section[first : first + len(block.nodes)]
            numbers = np.arange(first, first + len(block.nodes))
            first += len(block.nodes)
            for kind in dict.fromkeys(kinds[n] for n in section if n >= 0):
                chosen = np.isin(section, [n for n in kinds if kinds[n] == kind])
                self._add_body(block.element, block.nodes[chosen], section[chosen], numbers[chosen], averaged)

    def _add_body(
        self,
        element: str,
        nodes: np.ndarray,
        section: np.ndarray,
        numbers: np.ndarray,
        averaged: bool,
    ) -> None:
        gauss = len(rule(element)[1])
        own = [self._materials[s] for s in section]
        everywhere = spread(own, [gauss] * len(section))
        thickness = np.array([self.deck.sections[s].thickness for s in section])
        initial, stretched = initial_state(self.deck, self.path, numbers, own)
        try:
            points = self.deck.mesh.points
            body = Body(element, points, nodes, everywhere, thickness, initial, averaged, stretched)
        except ValueError as error:
            raise InputError(self.path, "*ELEMENT", error, "elements with positive Jacobian") from error
        term = None
        if ELEMENTS[element].nodal:
            from fingerfit.fem.volume import AveragedVolume

            term = AveragedVolume(body, section, self._materials)
        expansion = np.array([self.deck.expansion.get(self.deck.sections[s].material, 0.0) for s in section])
        if expansion.any():
            if not self.finite:
                raise InputError(self.path, "*STEP", "no NLGEOM", "NLGEOM: materials with *EXPANSION need it")
            self.expands.append((body, term, expansion, from_corners(element)))
        if any(self.deck.sections[s].material in self.deck.warmed for s in section):
            self.warms.append((body, term, section, from_corners(element)))
        if self.finite:
            self.bodies.append(body)
            self.terms += [term] if term else []
        else:
            from fingerfit.fem.linear import LinearBody, LinearTerm

            self.bodies.append(LinearBody(body))
            self.terms += [LinearTerm(term, self.size)] if term else []

    def temperature_of(self, given: Mapping[int, float]) -> np.ndarray:
        """Temperatures of all nodes, shape (nodes,); the initial ones where none is given."""
        found = np.zeros(len(self.deck.mesh.points))
        for node, value in (self.deck.temperature | dict(given)).items():
            found[node] = value
        return found

    def temperature_in(self, step: DeckStep) -> np.ndarray:
        """Temperatures of all nodes that a step names, shape (nodes,), without their amplitudes."""
        return self.temperature_of({node: value for (node, _), value in step.temperature.items()})

    def warm(self, temperature: np.ndarray) -> None:
        """Let nodes have temperatures, shape (nodes,): constants follow, and materials swell by the change since the
        beginning.
        """
        self.temperature = temperature
        for body, term, section, weights in self.warms:
            self._warm(body, term, section, temperature[body.connectivity[:, : weights.shape[1]]] @ weights.T)
        for body, term, expansion, weights in self.expands:
            change = (temperature - self._begun)[body.connectivity[:, : weights.shape[1]]] @ weights.T
            stretch = 1 + expansion[:, None] * change
            if not stretch.min() > 0:
                raise InputError(self.path, "*TEMPERATURE", "a body that shrinks to nothing", "a smaller change")
            body.swell(stretch.ravel())
            if term is not None:
                term.swell(stretch[:, 0])

    def _warm(self, body: Any, term: Any, section: np.ndarray, at: np.ndarray) -> None:
        """Give points the constants at their temperatures, shape (elements, points)."""
        for number in np.unique(section):
            table = self.deck.warmed.get(self.deck.sections[number].material)
            if table is None:
                continue
            own = section == number
            points = np.flatnonzero(np.repeat(own, at.shape[1]))
            body.warm(warmed(body.points.material, points, table, at[own].ravel()))
            if term is not None:
                term.warm(number, table, at.mean(axis=1))

    def _add_rigid(self) -> None:
        still = self._never_turned()
        for body in self.deck.rigid:
            nodes = np.array(body.nodes, dtype=int)
            if not len(nodes):
                continue
            keys = body.turning(self.dim)
            if all(key in still for key in keys):
                for node in nodes:
                    for axis in range(self.dim):
                        self._tie(int(node) * self.dim + axis, [(body.reference * self.dim + axis, 1.0)])
                continue
            dofs = []
            for node, axis in keys:
                if axis >= self.dim:
                    self._extra.setdefault((node, axis), self.nodal + len(self._extra))
                dofs.append(self.dof(node, axis))
            from fingerfit.fem.rigid import RigidBody

            self.rigid.append(RigidBody(nodes, body.reference, np.array(dofs), self.deck.mesh.points))

    def turns(self, body: Rigid) -> bool:
        """Whether a rigid body is free to turn, or turned, in any step."""
        return not set(body.turning(self.dim)) <= self._never_turned()

    def _never_turned(self) -> set[tuple[int, int]]:
        """Nodes and axes that are held at 0 in all steps."""
        steps = self.deck.steps
        return {
            key
            for key in steps[0].displacement
            if all(step.displacement.get(key) == 0.0 and key not in step.kept for step in steps)
        }

    def _tie(self, slave: int, masters: list[tuple[int, float]]) -> None:
        if slave in self.ties:
            raise self._not_free(slave)
        self.ties[slave] = masters

    def _settle_ties(self) -> list[tuple[int, list[tuple[int, float]]]]:
        """Nodes that are tied to others, with weights; they are put on the master's faces where a tie adjusts."""
        from fingerfit.fem.ties import tie_nodes
        from fingerfit.mesh.faces import collect_faces

        found = []
        points = self.deck.mesh.points.copy()
        small = 1e-9 * np.ptp(points, axis=0).max()
        for tie in self.deck.ties:
            masters_of = collect_faces(points, self.faces(tie.master))
            if not masters_of:
                raise InputError(self.path, "*TIE", tie.master, "a master surface of elements")
            weights_of = tie_nodes(self.nodes_of(tie.slave), masters_of, points, tie.tolerance)
            if not weights_of:
                expected = "a slave surface beside its master, or a larger POSITION TOLERANCE"
                raise InputError(self.path, "*TIE", f"no node of {tie.slave} at {tie.master}", expected)
            found += list(weights_of.items())
            places = {node: sum(w * points[n] for n, w in weights) for node, weights in weights_of.items()}
            for node, place in places.items():
                if tie.adjust and np.linalg.norm(place - points[node]) > small:
                    points[node] = place
        self.deck = replace(self.deck, mesh=replace(self.deck.mesh, points=points))
        return found

    def _add_ties(self, tied: list[tuple[int, list[tuple[int, float]]]]) -> None:
        for terms in self.deck.equations:
            for node, axis, _ in terms:
                if self.dof(node, axis) < 0:
                    raise InputError(self.path, "*EQUATION", f"axis {axis + 1}", f"axes 1 to {self.dim}")
            (slave, axis, factor), *others = terms
            masters = [(self.dof(n, a), -f / factor) for n, a, f in others]
            self._tie(self.dof(slave, axis), masters)
        for node, weights in tied:
            for axis in range(self.dim):
                self._tie(node * self.dim + axis, [(n * self.dim + axis, w) for n, w in weights])

    def faces(self, surface: str) -> list[tuple[str, np.ndarray, int, float]]:
        """Faces of a surface as `fingerfit.mesh.faces.collect_faces` takes them."""
        return self._described(self.deck.surfaces[surface].faces)

    def _described(self, faces: list[tuple[int, int]]) -> list[tuple[str, np.ndarray, int, float]]:
        elements = self.elements if faces else []
        found = []
        for number, face in faces:
            element = elements[number]
            thickness = 1.0
            if ELEMENTS[element.kind].state == AXISYMMETRIC:
                thickness = 0.0
            elif self.dim == 2 and element.section >= 0:
                thickness = self.deck.sections[element.section].thickness
            found.append((element.kind, element.nodes, face, thickness))
        return found

    def nodes_of(self, surface: str) -> np.ndarray:
        """Nodes of a surface."""
        from fingerfit.mesh.faces import faces_of

        nodes = [*self.deck.surfaces[surface].nodes, *(n for f in self.deck.surfaces[surface].facets for n in f)]
        for kind, connectivity, face, _ in self.faces(surface):
            nodes += connectivity[list(faces_of(kind)[face])].tolist()
        return np.unique(np.array(nodes, dtype=int))

    def _add_forces(self) -> None:
        deck, points = self.deck, self.deck.mesh.points
        if deck.springs:
            from fingerfit.fem.forces import NonlinearSprings, Springs

            first = np.array([self.dof(*s.first) for s in deck.springs])
            second = np.array([self.dof(*s.second) if s.second else -1 for s in deck.springs])
            bent = np.array([bool(s.table) for s in deck.springs])
            if not bent.all():
                stiffness = np.array([s.stiffness for s in deck.springs])
                self.terms.append(Springs(first[~bent], second[~bent], stiffness[~bent]))
            if bent.any():
                tables = [s.table for s in deck.springs if s.table]
                self.terms.append(NonlinearSprings(first[bent], second[bent], tables))
        loaded = list(dict.fromkeys(face for step in deck.steps for face in step.pressure))
        if loaded:
            from fingerfit.fem.forces import Pressure
            from fingerfit.mesh.faces import collect_faces

            sizes: dict[int, list[tuple[int, int]]] = {}
            for key, described in zip(loaded, self._described(loaded), strict=True):
                only = collect_faces(points, [described])[0]
                sizes.setdefault(only.nodes.shape[1], []).append(key)
            for keys in sizes.values():
                term = Pressure(collect_faces(points, self._described(keys))[0], points, self.size)
                self.pressures.append((term, keys))
                if self.finite:
                    self.terms.append(term)
