"""Contact pairs of a deck as terms of the built-in solver."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.deck.content import Law, Rigid, Surface
from fingerfit.fem.contact import Interaction, RigidContact
from fingerfit.fem.facets import Facets, cut_faces, rigid_faces
from fingerfit.fem.surfaces import Plane, RigidSurface, Round
from fingerfit.mesh.faces import collect_faces, depth_behind, sample_faces
from fingerfit.solvers.model import Model

_HARD = 100.0
"""Stiffness of hard contact over that of the elements behind it."""


def add_contacts(model: Model) -> None:
    """Add a term for each contact pair."""
    from scipy.sparse import csr_matrix

    deck, points = model.deck, model.deck.mesh.points
    if not model.finite:
        raise InputError(model.path, "*CONTACT PAIR", "no NLGEOM", "*STEP, NLGEOM")
    for pair in deck.contacts:
        owner = _owner(model, pair.master)
        nodes = model.nodes_of(pair.slave)
        faces = model.faces(pair.slave)
        if not len(nodes):
            raise InputError(model.path, "*CONTACT PAIR", f"{pair.slave} without faces or nodes", "a slave surface")
        if deck.surfaces[pair.slave].facets:
            raise InputError(model.path, "*CONTACT PAIR", f"rigid elements in {pair.slave}", "a slave that deforms")
        if owner.surface == pair.master:
            behind = np.unique(np.concatenate([nodes, *(connectivity for _, connectivity, _, _ in faces)]))
            surface = rigid_surface(deck.surfaces[pair.master], points[behind])
            if surface is None:
                expected = "a line, a circle or their sweep: a plane, a cylinder or a sphere on its axis"
                raise InputError(model.path, f"*SURFACE {pair.master}", "another profile", expected)
        else:
            meshed = collect_faces(points, model.faces(pair.master))
            meshed += rigid_faces(deck.surfaces[pair.master].facets, model.dim)
            try:
                surface = Facets(points, cut_faces(meshed, model.dim))
            except ValueError as error:
                raise InputError(model.path, f"*SURFACE {pair.master}", error, "facets with an area") from error
        if faces:
            sampling, areas = sample_faces(collect_faces(points, faces), points, pair.at_nodes)
        else:
            shape = (len(nodes), len(points))
            sampling = csr_matrix((np.ones(len(nodes)), (np.arange(len(nodes)), nodes)), shape=shape)
            areas = np.ones(len(nodes))
        held = [{key for key in step.displacement if key[0] == owner.reference} for step in deck.steps]
        driven = any(len({axis for _, axis in keys if axis < model.dim}) < model.dim for keys in held)
        law = deck.laws[pair.interaction]
        if law.hard:
            law = replace(law, stiffness=_hard(model, pair.slave))
        interaction = _interaction(model, pair.interaction, law)
        model.terms.append(RigidContact(sampling, areas, points, surface, owner.reference, interaction, driven))


def _owner(model: Model, master: str) -> Rigid:
    """The rigid body that a master surface belongs to: its analytical surface, or faces between its nodes."""
    for body in model.deck.rigid:
        if body.surface == master:
            _refuse_turns(model, body)
            return body
    surface = model.deck.surfaces[master]
    nodes = set(model.nodes_of(master).tolist()) if surface.faces or surface.facets else set()
    for body in model.deck.rigid:
        if nodes and nodes <= {*body.nodes, body.reference}:
            if model.turns(body):
                raise InputError(
                    model.path, "*CONTACT PAIR", f"{master} on a body that turns", "its rotation held in all steps"
                )
            return body
    expected = "an analytical surface of a *RIGID BODY, or faces of elements or rigid elements in one"
    raise InputError(model.path, "*CONTACT PAIR", master, expected)


def _refuse_turns(model: Model, body: Rigid) -> None:
    """An analytical surface does not turn: refuse what would turn it."""
    keys = set(body.turning(model.dim))
    turned = [f"{body.surface} with a prescribed rotation"] * any(
        step.displacement.get(key) for step in model.deck.steps for key in keys
    )
    turned += [f"{body.surface} with a moment"] * any(step.force.get(key) for step in model.deck.steps for key in keys)
    turned += [f"{body.surface} on a body that turns"] * any(
        other.nodes and keys & set(other.turning(model.dim)) and model.turns(other) for other in model.deck.rigid
    )
    if turned:
        raise InputError(model.path, "*CONTACT PAIR", turned[0], "an analytical surface that does not turn")


def _hard(model: Model, slave: str) -> float:
    """Slope in MPa/mm in place of hard contact.

    A hundred times the largest Young's modulus of the elements behind the slave's faces over their depth: at a pressure
    of that modulus the overclosure is a hundredth of an element. Found on a sphere pressed into a block of 6 x 6 x 3
    C3D8, nu = 0.495: 99.3 % of the force of contact three times as stiff, and 91 % with ten times the modulus. With
    the modulus of confined compression instead, no equilibrium was found at nu = 0.4999.
    """

    @cache
    def young(section: int) -> float:
        tangent = model.material(section).derivatives(np.ones((1, 3)))[1][0]
        return float(1 / np.linalg.inv(tangent)[0, 0])

    found = []
    elements, points = model.elements, model.deck.mesh.points
    for number, face in model.deck.surfaces[slave].faces:
        element = elements[number]
        if element.section >= 0:
            found.append(young(element.section) / depth_behind(points, element.kind, element.nodes, face))
    if not found:
        expected = "a slave surface of faces, or PRESSURE-OVERCLOSURE=LINEAR"
        raise InputError(model.path, "*SURFACE BEHAVIOR", f"HARD with {slave}, which has no faces", expected)
    return _HARD * float(max(found))


def _interaction(model: Model, name: str, law: Law) -> Interaction:
    where = f"*SURFACE INTERACTION {name}"
    if law.stiffness == 0:
        raise InputError(model.path, where, "no stiffness", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR or HARD")
    stick = law.stick or law.stiffness
    if law.rough and not law.separates:
        return Interaction(law.stiffness, stick=stick, glued=True)
    if not law.separates:
        raise InputError(model.path, where, "NO SEPARATION alone", "*FRICTION, ROUGH with it: glued")
    if law.rough:
        return Interaction(law.stiffness, friction=1e9, stick=stick)
    return Interaction(law.stiffness, law.friction, stick if law.friction else 0.0)


def rigid_surface(surface: Surface, slaves: np.ndarray) -> RigidSurface | None:
    """Geometry of an analytical surface, without the ends of its profile; the body's side is where its slaves are.

    Parameters
    ----------
    surface : Surface
        With a profile of one LINE or CIRCL.
    slaves : ndarray, shape (nodes, dim)
        Positions of the nodes of slave elements, mm.

    Returns
    -------
    RigidSurface or None
        None for a shape that is not known.
    """
    dim = slaves.shape[1]
    if (surface.kind == "SEGMENTS") != (dim == 2):
        return None
    axes, origin = surface.axes[:dim, :dim], surface.origin[:dim]
    (_, start), (word, values) = surface.profile
    first, last = np.array(start), np.array(values[:2])
    if word == "LINE":
        way = last - first
        if surface.kind == "REVOLUTION":
            if abs(way[0]) < 1e-9 * abs(way[1]):
                return _facing_round(Round(origin, float(first[0]), 1, axes[2]), slaves)
            if abs(way[1]) > 1e-9 * abs(way[0]):
                return None
            return _facing_plane(origin + first[1] * axes[2], axes[2], slaves)
        normal = np.array([-way[1], way[0]]) / np.linalg.norm(way)
        return _facing_plane(origin + first @ axes[:2], normal @ axes[:2], slaves)
    centre, radius = np.array(values[2:]), float(np.linalg.norm(first - np.array(values[2:])))
    if surface.kind == "REVOLUTION":
        if abs(centre[0]) > 1e-9 * radius:
            return None
        return _facing_round(Round(origin + centre[1] * axes[2], radius), slaves)
    along = axes[2] if dim == 3 else None
    return _facing_round(Round(origin + centre @ axes[:2], radius, 1, along), slaves)


def _facing_plane(point: np.ndarray, normal: np.ndarray, slaves: np.ndarray) -> Plane:
    side = np.sign(((slaves - point) @ normal).mean()) or 1.0
    return Plane(point, side * normal)


def _facing_round(shape: Round, slaves: np.ndarray) -> Round:
    gap = shape.gap(slaves)[0]
    # a few nodes may overlap: where most of the body lies decides
    side = -1 if np.median(gap) <= 1e-9 * shape.radius else 1
    return Round(shape.centre, shape.radius, side, shape.axis)
