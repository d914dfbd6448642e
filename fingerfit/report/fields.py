"""Strain and stress in the elements of a solved deck."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.deck.reader import read_deck
from fingerfit.fem.assembly import Body
from fingerfit.material.invariant import TENSOR
from fingerfit.mesh.elements import rule, shape
from fingerfit.mesh.mesh import Mesh
from fingerfit.solvers.analysis import load_at_end
from fingerfit.solvers.model import Model


@dataclass(frozen=True)
class Fields:
    """Means over elements, weighted by volume; NaN where an element is turned inside out.

    Parameters
    ----------
    strain : ndarray, shape (elements, 3, 3)
        Green-Lagrange, 1.
    volume : ndarray, shape (elements,)
        Ratio of the deformed to the reference volume.
    stress : ndarray or None, shape (elements, 3, 3)
        Cauchy stress, MPa; NaN in rigid elements.
    """

    strain: np.ndarray
    volume: np.ndarray
    stress: np.ndarray | None

    @property
    def von_mises(self) -> np.ndarray | None:
        """Von Mises stress, shape (elements,), MPa."""
        if self.stress is None:
            return None
        mean = np.trace(self.stress, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return np.sqrt(1.5 * ((self.stress - mean) ** 2).sum(axis=(1, 2)))


def strains(mesh: Mesh, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Green-Lagrange strain, shape (elements, 3, 3), and ratio of volume of the elements of a mesh.

    Parameters
    ----------
    mesh : Mesh
    displacement : ndarray, shape (nodes, dim)
        mm.
    """
    strain, volume = [], []
    for block in mesh.blocks:
        xi, weights = rule(block.element)
        local = shape(block.element, xi)[1]
        jacobian = np.einsum("eni,gnj->egij", mesh.points[block.nodes], local)
        gradient = np.einsum("gnj,egji->egni", local, np.linalg.inv(jacobian))
        weight = np.linalg.det(jacobian) * weights
        f = np.einsum("eni,egnj->egij", displacement[block.nodes], gradient) + np.eye(mesh.dim)
        green, ratio = (np.swapaxes(f, -1, -2) @ f - np.eye(mesh.dim)) / 2, np.linalg.det(f)
        share = weight / weight.sum(axis=1, keepdims=True)
        whole = np.zeros((len(block.nodes), 3, 3))
        whole[:, : mesh.dim, : mesh.dim] = (share[..., None, None] * green).sum(axis=1)
        turned = (ratio <= 0).any(axis=1)
        whole[turned] = np.nan
        strain.append(whole)
        volume.append(np.where(turned, np.nan, (share * ratio).sum(axis=1)))
    return np.concatenate(strain), np.concatenate(volume)


def fields(mesh: Mesh, deck: Path, displacement: np.ndarray, step: int | None = None) -> Fields:
    """Strain and stress of a state of a deck.

    Parameters
    ----------
    mesh : Mesh
        Of the elements that are wanted; its nodes are the first ones of the deck.
    deck : Path
        With the materials. Stress that depends on what was before (viscoelasticity) is left out.
    displacement : ndarray, shape (nodes of the deck, dim)
        mm.
    step : int, optional
        Of the deck, from 0: temperatures are those at its end; without it those at the beginning.

    Raises
    ------
    InputError
        For a deck that is not understood.
    """
    strain, volume = strains(mesh, displacement[: len(mesh.points)])
    return Fields(strain, volume, _stress(mesh, deck, displacement, step))


def _stress(mesh: Mesh, deck: Path, displacement: np.ndarray, step: int | None) -> np.ndarray | None:
    model = Model(read_deck(deck), deck)
    model.warm(model.temperature)
    if step is not None:
        load_at_end(model, model.deck.steps[step])
    if not all(isinstance(body, Body) and body.history is None for body in model.bodies):
        return None
    averaged = {id(term.connectivity): term for term in model.terms if hasattr(term, "share")}
    number = {}
    for index, nodes in enumerate(nodes for block in mesh.blocks for nodes in block.nodes):
        number[tuple(nodes.tolist())] = index
    found, known = np.zeros((mesh.element_count, 3, 3)), np.zeros(mesh.element_count, dtype=bool)
    u = np.zeros(model.size)
    u[: displacement.size] = displacement.ravel()
    for body in model.bodies:
        own = np.array([number.get(tuple(nodes), -1) for nodes in body.connectivity.tolist()])
        stress = _of_body(body, u)
        if id(body.connectivity) in averaged:
            stress += _averaged(averaged[id(body.connectivity)], u)
        # elements that lie over each other, as fibres in tissue do, bear the load together
        np.add.at(found, own[own >= 0], stress[own >= 0])
        known[own[own >= 0]] = True
    found[~known] = np.nan
    return found


def _of_body(body: Body, u: np.ndarray) -> np.ndarray:
    """Cauchy stress of a body's elements without the part that is averaged at nodes, shape (elements, 3, 3), MPa."""
    dim = body.dim
    f = np.zeros((*body.weight.shape, 3, 3))
    plane, across = body.deformation(u)
    f[..., 2, 2] = across
    f[..., :dim, :dim] = plane
    turned = (np.linalg.det(f) <= 0).any(axis=1)
    f[turned] = np.eye(3)
    squared, directions = np.linalg.eigh(np.swapaxes(f, -1, -2) @ f)
    frame = directions.reshape(-1, 3, 3)
    if body.kind.state == "plane stress":
        third = body.points.thickness_stretch(_third_last(squared, directions), None)
        if third is not None:
            f[..., 2, 2] = np.sqrt(third).reshape(f.shape[:2])
            squared, directions = np.linalg.eigh(np.swapaxes(f, -1, -2) @ f)
            frame = directions.reshape(-1, 3, 3)
    stretch = np.sqrt(squared).reshape(-1, 3)
    first, _ = body.points.isotropic(stretch)
    ratio = stretch.prod(axis=1)
    if body.pressure is not None:
        shape = body.weight.shape

        def project(values: np.ndarray) -> np.ndarray:
            return (body.pressure @ values.reshape(shape)[..., None]).ravel()

        first = first + (project(body.points.volumetric(project(ratio))[1]) * ratio)[:, None]
    second = np.zeros((len(first), 3, 3))
    second[:, range(3), range(3)] = first / squared.reshape(-1, 3)
    if body.points.directed:
        part = body.points.directions(squared.reshape(-1, 3), frame).stress
        second += part[:, TENSOR]
    turn = f.reshape(-1, 3, 3) @ frame
    cauchy = (turn @ second @ np.swapaxes(turn, 1, 2)) / ratio[:, None, None]
    weight = body.weight * ratio.reshape(body.weight.shape)
    share = weight / weight.sum(axis=1, keepdims=True)
    mean = (share[..., None, None] * cauchy.reshape(*body.weight.shape, 3, 3)).sum(axis=1)
    mean[turned] = np.nan
    return mean


def _third_last(squared: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Squared stretches in the plane and, last, that out of it, shape (points, 3)."""
    flat, axes = squared.reshape(-1, 3), directions.reshape(-1, 3, 3)
    out = np.abs(axes[:, 2]).argmax(axis=1)
    order = np.array([[1, 2, 0], [0, 2, 1], [0, 1, 2]])[out]
    return np.take_along_axis(flat, order, axis=1)


def _averaged(term: Any, u: np.ndarray) -> np.ndarray:
    """Pressure that the nodes of an element have on average, as a stress, shape (elements, 3, 3), MPa."""
    local = u[term._dofs].reshape(*term.connectivity.shape, term.dim)
    jacobian = np.linalg.det(np.swapaxes(local, 1, 2) @ term.gradient + np.eye(term.dim))
    if term.hoop is not None:
        jacobian = jacobian * (1 + (term.hoop * local[:, :, 0]).sum(axis=1))
    pressure = term._elastic(term._mean(jacobian))[1]
    return ((term.share.T @ pressure) / term.volume)[:, None, None] * np.eye(3)
