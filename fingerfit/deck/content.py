"""What a deck says, in zero-based numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fingerfit.mesh.mesh import Mesh

NodeAxis = tuple[int, int]
"""Node and axis, zero-based; axes from 3 are rotations."""
ElementFace = tuple[int, int]
"""Element (through all blocks) and face, zero-based."""


@dataclass
class Section:
    """Elements of a set, their material, thickness in mm and axes."""

    elset: str
    material: str
    thickness: float
    orientation: str = ""


@dataclass(frozen=True)
class Orientation:
    """Local axes.

    Parameters
    ----------
    axes : ndarray, shape (3, 3)
        Local axes as rows.
    directions : tuple of (float, float, float)
        Of fibres, in the local axes.
    """

    axes: np.ndarray
    directions: tuple[tuple[float, ...], ...] = ()


Table = tuple[tuple[float, float], ...]
"""Force in N and relative displacement in mm of a nonlinear spring, displacements ascending."""


@dataclass(frozen=True)
class Spring:
    """Spring at one node and axis, to ground or to a second one.

    Parameters
    ----------
    stiffness : float
        N/mm, of a linear spring.
    table : Table
        Empty for a linear one.
    """

    first: NodeAxis
    second: NodeAxis | None
    stiffness: float
    table: Table = ()

    def force(self, moved: float) -> float:
        """Force in N at a relative displacement in mm, that of the first end less that of the second one.

        A table is followed by straight lines; beyond its ends the force is that of the end.
        """
        if not self.table:
            return self.stiffness * moved
        forces, displacements = zip(*self.table, strict=True)
        return float(np.interp(moved, displacements, forces))


@dataclass
class Surface:
    """Faces of elements, or nodes; or the profile of an analytical rigid surface.

    Parameters
    ----------
    faces : list of (element, face)
    nodes : list of int
    profile : list of (str, list of float)
        START, LINE and CIRCL with their numbers, in local coordinates.
    kind : str
        ELEMENT, NODE, SEGMENTS, CYLINDER or REVOLUTION.
    origin, axes : ndarray, shape (3,) and (3, 3)
        Local system of an analytical surface, axes as rows.
    facets : list of tuple of int
        Nodes of rigid elements, in the order that makes their normal point to the side that is named.
    """

    kind: str
    faces: list[ElementFace] = field(default_factory=list)
    nodes: list[int] = field(default_factory=list)
    profile: list[tuple[str, list[float]]] = field(default_factory=list)
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    facets: list[tuple[int, ...]] = field(default_factory=list)

    def move(self, turn: np.ndarray, offset: np.ndarray) -> None:
        """Turn an analytical surface by a rotation (3, 3) about the origin, then move it by an offset in mm."""
        if self.kind == "SEGMENTS":
            for _, values in self.profile:
                places = np.array(values).reshape(-1, 2) @ turn[:2, :2].T + offset[:2]
                values[:] = places.ravel().tolist()
        else:
            self.origin = turn @ self.origin + offset
            self.axes = self.axes @ turn.T


@dataclass(frozen=True)
class Rigid:
    """Nodes, elements and an analytical surface that move with a reference node.

    Parameters
    ----------
    reference : int
        Node of the translations.
    rotation : int
        Node whose displacements are the rotation (CalculiX, ROT NODE); -1 for the reference node's axes 4 to 6.
    nodes, elements : tuple of int
    surface : str
        Analytical surface, or nothing.
    """

    reference: int
    rotation: int
    nodes: tuple[int, ...]
    elements: tuple[int, ...]
    surface: str

    def turning(self, dim: int) -> list[NodeAxis]:
        """Nodes and axes of the rotation."""
        if self.rotation >= 0:
            return [(self.rotation, axis) for axis in ((2,) if dim == 2 else range(3))]
        return [(self.reference, axis) for axis in ((5,) if dim == 2 else (3, 4, 5))]


@dataclass
class Law:
    """Surface interaction; see `fingerfit.fem.contact.Interaction`."""

    stiffness: float = 0.0
    friction: float = 0.0
    stick: float = 0.0
    rough: bool = False
    separates: bool = True
    hard: bool = False


@dataclass(frozen=True)
class ContactPair:
    """Slave and master surface with the name of their interaction, at nodes or at integration points."""

    slave: str
    master: str
    interaction: str
    at_nodes: bool


@dataclass(frozen=True)
class Tie:
    """Slave and master surface that are tied.

    Parameters
    ----------
    tolerance : float or None
        Distance in mm up to which nodes are.
    adjust : bool
        Whether the slave's nodes are put on the master before anything else.
    """

    slave: str
    master: str
    tolerance: float | None
    adjust: bool = True


@dataclass
class DeckStep:
    """One loading step; the values are totals that hold at its end.

    Parameters
    ----------
    displacement : dict
        Prescribed displacements in mm by (node, axis).
    kept : set
        Those of them that stay what they are when the step begins, whatever is prescribed (``*BOUNDARY, FIXED``).
    force : dict
        Concentrated forces in N by (node, axis).
    pressure : dict
        Pressures in MPa by (element, face).
    temperature : dict
        Temperatures by (node, 0); the initial ones where there are none.
    curve : dict
        Name of the amplitude by (kind of load, key), where there is one.
    increment, largest : float
        First and largest increment as shares of the step.
    fixed : bool
        Whether all increments are alike.
    period : float
        Length, s.
    viscous, relaxed : bool
        Whether time passes for materials, or has no end.
    sudden : bool
        Whether loads without amplitude are there at once, not on a ramp.
    finite : bool
        NLGEOM.
    printed : bool
        Whether it prints the nodes ALL, or one before it does: where some steps do, those before are on the way and
        no results.
    """

    displacement: dict[NodeAxis, float] = field(default_factory=dict)
    force: dict[NodeAxis, float] = field(default_factory=dict)
    pressure: dict[ElementFace, float] = field(default_factory=dict)
    curve: dict[tuple[str, tuple[int, int]], str] = field(default_factory=dict)
    increment: float = 1.0
    largest: float = 1.0
    fixed: bool = False
    period: float = 1.0
    viscous: bool = False
    relaxed: bool = False
    sudden: bool | None = None
    temperature: dict[NodeAxis, float] = field(default_factory=dict)
    kept: set[NodeAxis] = field(default_factory=set)
    finite: bool = True
    printed: bool = False


@dataclass
class Deck:
    """What a deck says.

    Parameters
    ----------
    labels : list of (str, int)
        Instance (or nothing) and label of each node.
    stress : dict
        Stress in the reference state by element, MPa: 11, 22, 33, 12, 13, 23.
    strain : dict
        Strain by element at which an elastic material is free of stress.
    amplitudes : dict
        Name to times in s and factors.
    expansion : dict
        Linear expansion by a degree, of materials that have one.
    temperature : dict
        Initial temperature by node; 0 elsewhere.
    warmed : dict
        Of materials whose constants depend on the temperature: temperatures from the lowest on, each with the material
        there; in `materials` is the first one.
    """

    mesh: Mesh
    materials: dict[str, Any]
    sections: list[Section]
    equations: list[list[tuple[int, int, float]]]
    fixed: dict[NodeAxis, float]
    steps: list[DeckStep]
    labels: list[tuple[str, int]] = field(default_factory=list)
    orientations: dict[str, Orientation] = field(default_factory=dict)
    springs: list[Spring] = field(default_factory=list)
    surfaces: dict[str, Surface] = field(default_factory=dict)
    rigid: list[Rigid] = field(default_factory=list)
    laws: dict[str, Law] = field(default_factory=dict)
    contacts: list[ContactPair] = field(default_factory=list)
    ties: list[Tie] = field(default_factory=list)
    stress: dict[int, list[float]] = field(default_factory=dict)
    strain: dict[int, list[float]] = field(default_factory=dict)
    amplitudes: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    expansion: dict[str, float] = field(default_factory=dict)
    temperature: dict[int, float] = field(default_factory=dict)
    warmed: dict[str, list[tuple[float, Any]]] = field(default_factory=dict)
