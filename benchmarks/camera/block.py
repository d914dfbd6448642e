"""Mesh of a layered block: quadrilaterals with nine nodes on a grid, smaller towards the sides and the layers' ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

FEWEST = 4
"""Rows of elements of a layer, at least."""


def quadratic(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quadratic shape functions on the line from -1 to 1, and their derivatives, both (..., 3)."""
    values = np.stack([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2], -1)
    slopes = np.stack([s - 0.5, -2 * s, s + 0.5], -1)
    return values, slopes


def shape_functions(xi: np.ndarray, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (..., 9) at local coordinates, and their derivatives (..., 9, 2).

    Node 3 j + i is the i-th along xi and the j-th along eta.
    """
    along, along_slope = quadratic(xi)
    up, up_slope = quadratic(eta)
    values = (up[..., :, None] * along[..., None, :]).reshape(*xi.shape, 9)
    by_xi = (up[..., :, None] * along_slope[..., None, :]).reshape(*xi.shape, 9)
    by_eta = (up_slope[..., :, None] * along[..., None, :]).reshape(*xi.shape, 9)
    return values, np.stack([by_xi, by_eta], -1)


def graded(count: int, ratio: float) -> np.ndarray:
    """Ends of intervals on [0, 1]; those in the middle are about `ratio` times as long as those at the ends."""
    ends = np.linspace(0, 1, count + 1)
    middle = (ends[1:] + ends[:-1]) / 2
    lengths = 1 + (ratio - 1) * np.sin(np.pi * middle)
    places = np.concatenate([[0], np.cumsum(lengths)])
    return places / places[-1]


def with_middles(places: np.ndarray) -> np.ndarray:
    """Places and the middles between them, in order."""
    return np.sort(np.concatenate([places, (places[1:] + places[:-1]) / 2]))


class Block:
    """A block from x = 0 to the width and from y = 0 to the height.

    Parameters
    ----------
    width : float
        Width, mm.
    heights : sequence of float
        Heights of the layers from the base to the plate, mm.
    across, up : int
        Elements along the width and, about, along the height.
    grading_across, grading_up : float
        Length of the elements in the middle of the width, or of a layer, over that at its ends.
    warp : callable or None
        Moves the nodes (nodes, 2) of the rectangle to those of the body's natural shape.

    Attributes
    ----------
    nominal, nodes : ndarray (nodes, 2)
        Nodes in the rectangle and in the natural shape, mm.
    elements : ndarray (elements, 9)
        Nodes of each element.
    layer : ndarray (elements,)
        Layer of each element, from the base on.
    bottom, top : ndarray
        Nodes at the base and at the plate.
    nominal_points : ndarray (elements, 9, 2)
        Integration points in the rectangle, mm.
    gradients : ndarray (elements, 9, 9, 2)
        Derivatives of the shape functions by place: element, point, node, axis; 1/mm.
    volumes : ndarray (elements, 9)
        Area that each integration point stands for, mm^2.
    strain : ndarray (elements, 9, 4, 18)
        Displacement gradient (as a row of four) at each point, by the displacements of the element's nodes.
    pressures : ndarray (9, 3)
        Shape functions of the pressure at the points: 1, xi and eta, for each element by itself.
    dofs : ndarray (elements, 18)
        Degrees of freedom of each element; those of node n are 2 n and 2 n + 1.
    """

    def __init__(
        self,
        width: float,
        heights: Sequence[float],
        across: int,
        up: int,
        grading_across: float = 2.5,
        grading_up: float = 1.6,
        warp: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        self.width, self.height = width, sum(heights)
        self._number_nodes(heights, across, up, grading_across, grading_up)
        self.nodes = warp(self.nominal) if warp else self.nominal
        self._integrate()
        self._number_dofs()

    def _number_nodes(
        self, heights: Sequence[float], across: int, up: int, grading_across: float, grading_up: float
    ) -> None:
        levels = np.concatenate([[0], np.cumsum(heights)])
        rows = [up] if len(heights) == 1 else [max(FEWEST, round(up * h / self.height)) for h in heights]
        columns = self.width * graded(across, grading_across)
        lines = [np.array([0.0])]
        layers: list[int] = []
        for number, (height, count) in enumerate(zip(heights, rows, strict=True)):
            lines.append(levels[number] + height * graded(count, grading_up)[1:])
            layers += [number] * count
        x, y = with_middles(columns), with_middles(np.concatenate(lines))
        wide = len(x)
        self.nominal = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
        self.elements = np.array(
            [
                [(2 * row + j) * wide + 2 * column + i for j in range(3) for i in range(3)]
                for row in range(len(layers))
                for column in range(across)
            ]
        )
        self.layer = np.repeat(np.array(layers), across)
        self.bottom = np.arange(wide)
        self.top = np.arange(wide) + (len(y) - 1) * wide

    def _integrate(self) -> None:
        """Shape functions at 3 x 3 Gauss points of each element."""
        places = np.sqrt(0.6) * np.array([-1, 0, 1])
        weights = np.array([5, 8, 5]) / 9
        xi, eta = (axis.ravel() for axis in np.meshgrid(places, places))
        values, slopes = shape_functions(xi, eta)
        jacobian = np.einsum("eai,qaj->eqij", self.nodes[self.elements], slopes)
        det = np.linalg.det(jacobian)
        if det.min() <= 0:
            raise ValueError("an element is turned inside out")
        self.gradients = np.einsum("qaj,eqji->eqai", slopes, np.linalg.inv(jacobian))
        self.volumes = det * np.outer(weights, weights).ravel()
        self.nominal_points = np.einsum("qa,eai->eqi", values, self.nominal[self.elements])
        self.pressures = np.stack([np.ones(9), xi, eta], -1)
        count = len(self.elements)
        strain = np.zeros((count, 9, 2, 2, 9, 2))
        for i in range(2):
            strain[:, :, i, :, :, i] = self.gradients.swapaxes(2, 3)
        self.strain = strain.reshape(count, 9, 4, 18)

    def _number_dofs(self) -> None:
        count = len(self.elements)
        self.dofs = (2 * self.elements[:, :, None] + np.arange(2)).reshape(count, 18)
        self.matrix_rows = np.repeat(self.dofs, 18, 1).ravel()
        self.matrix_columns = np.tile(self.dofs, (1, 18)).ravel()
        self.dof_count = 2 * len(self.nodes)

    def edge_lengths(self, nodes: np.ndarray) -> np.ndarray:
        """Length of the edge that each node of the bottom or the top stands for, mm."""
        x = self.nodes[nodes, 0]
        lengths = np.zeros(len(nodes))
        for k in range(0, len(nodes) - 2, 2):
            lengths[k : k + 3] += (x[k + 2] - x[k]) * np.array([1 / 6, 4 / 6, 1 / 6])
        return lengths
