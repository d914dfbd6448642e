"""Change of volume averaged over the elements around each node, against the locking of linear triangles and tetrahedra.

The volumetric energy is sum_a V_a U(v_a / V_a) over the nodes a, where an element gives an equal share of its volume
to each of its nodes (Bonet and Burton, Commun. Numer. Methods Eng. 14, 1998). Where materials meet, each has a node of
its own, because the pressure jumps there. The tangent couples each node with all elements around its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from fingerfit.fem.assembly import Body
from fingerfit.fem.response import remembered, swollen
from fingerfit.fem.system import Contribution
from fingerfit.material.prony import history_of_pressure
from fingerfit.material.spread import spread, warmed


class AveragedVolume:
    """Volumetric energy of a body of linear triangles or tetrahedra.

    Parameters
    ----------
    body : Body
        Of an element type with `nodal`: it has the rest of the energy.
    groups : ndarray, shape (elements,), int
        Which material each element is of.
    materials : sequence of materials
        Of each group, with constants that are numbers.
    """

    symmetric = True

    def __init__(self, body: Body, groups: np.ndarray, materials: Any) -> None:
        from scipy.sparse import csr_matrix

        self.dim, self.connectivity = body.dim, body.connectivity
        self.volume, self.gradient = body.weight[:, 0], body.mesh_gradient[:, 0]
        self.hoop = None if body.mesh_hoop is None else body.mesh_hoop[:, 0]
        self._dofs = body.dofs
        elements, nodes = self.connectivity.shape
        cells = groups[:, None] * (int(self.connectivity.max()) + 1) + self.connectivity
        unique, index = np.unique(cells, return_inverse=True)
        at = index.reshape(cells.shape)
        owner = np.empty(len(unique), dtype=int)
        owner[at.ravel()] = np.repeat(groups, nodes)
        self.groups = np.unique(groups)
        self.material = [(materials[g], np.flatnonzero(owner == g)) for g in self.groups]
        share = np.repeat(self.volume / nodes, nodes)
        element = np.repeat(np.arange(elements), nodes)
        self.share = csr_matrix((share, (at.ravel(), element)), shape=(len(unique), elements))
        self.patch = np.asarray(self.share.sum(axis=1)).ravel()
        self.swelling = np.ones(len(unique))
        histories = ((history_of_pressure(one.prony, len(own)), own) for one, own in self.material)
        self._histories = [(history, own) for history, own in histories if history is not None]
        self._bulk, self._memory = np.ones(len(unique)), np.zeros(len(unique))
        self.begin(0.0)

    @property
    def dofs(self) -> np.ndarray:
        """Degrees of freedom of the body."""
        return np.unique(self._dofs)

    def begin(self, dt: float, relaxed: bool = False) -> None:
        """Get ready for a time increment of `dt` s; with `relaxed`, for an infinitely slow one."""
        for history, own in self._histories:
            self._bulk[own], self._memory[own] = history.begin(dt, relaxed)

    def commit(self, u: np.ndarray, dt: float, relaxed: bool = False) -> None:
        """Take the end of an increment into the history.

        Raises
        ------
        ValueError
            For an inverted element of a material that relaxes.
        """
        if not self._histories:
            return
        found = self._deformation(u)
        if found is None:
            raise ValueError("an increment cannot end with an inverted element")
        _, pressure, _ = self._elastic(self._mean(found[2]))
        for history, own in self._histories:
            history.commit(pressure[own], dt, relaxed)

    def swell(self, stretch: np.ndarray) -> None:
        """Let the elements swell, shape (elements,)."""
        self.swelling = self._mean(stretch**3)

    def warm(self, group: int, table: Sequence[tuple[float, Any]], at: np.ndarray) -> None:
        """Let the material of a group have its constants at the temperatures of all elements, shape (elements,)."""
        mean = self._mean(at)
        for n in np.flatnonzero(self.groups == group):
            own = self.material[n][1]
            anywhere = spread([table[0][1]], [len(own)])
            self.material[n] = warmed(anywhere, np.arange(len(own)), table, mean[own]), own

    def _deformation(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Deformation gradient, stretch around the axis (1 where there is none) and volume ratio."""
        local = u[self._dofs].reshape(*self.connectivity.shape, self.dim)
        f = np.swapaxes(local, 1, 2) @ self.gradient + np.eye(self.dim)
        around = np.ones(len(f)) if self.hoop is None else 1 + (self.hoop * local[:, :, 0]).sum(axis=1)
        area = np.linalg.det(f)
        return None if not min(area.min(), around.min()) > 0 else (f, around, area * around)

    def _volumetric(self, jacobian: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        ratio = self._mean(jacobian)
        return remembered(self._elastic(ratio), ratio, self._bulk, self._memory)

    def _mean(self, values: np.ndarray) -> np.ndarray:
        """Values of elements averaged around each node, by their volume."""
        return np.asarray((self.share @ values) / self.patch)

    def _elastic(self, ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        result = np.zeros((3, len(ratio)))
        for material, chosen in self.material:
            result[:, chosen] = swollen(material, ratio[chosen], self.swelling[chosen])
        return result[0], result[1], result[2]

    def energy(self, u: np.ndarray) -> float:
        """Volumetric energy in N mm."""
        found = self._deformation(u)
        return np.inf if found is None else float(self._volumetric(found[2])[0] @ self.patch)

    def forces(self, u: np.ndarray, tangent: bool = True) -> Contribution | None:
        """Forces of the nodal pressures and their tangent."""
        from scipy.sparse import csr_matrix, diags

        found = self._deformation(u)
        if found is None:
            return None
        f, around, jacobian = found
        _, pressure, bulk = self._volumetric(jacobian)
        # d(J_e V_e)/du of an element, and the pressure that acts on it: the mean of its nodes'
        by = flat = self.gradient @ np.linalg.inv(f)
        if self.hoop is not None:
            outward = np.zeros(flat.shape)
            outward[..., 0] = self.hoop / around[:, None]
            by = flat + outward
        slope = jacobian[:, None, None] * by
        elements, nodes = self.connectivity.shape
        acting = self.share.T @ pressure
        force = np.bincount(
            self._dofs.ravel(), weights=(acting[:, None] * slope.reshape(elements, -1)).ravel(), minlength=len(u)
        )
        empty = np.empty(0, dtype=int)
        if not tangent:
            return Contribution(force, empty, empty, np.empty(0))
        # second derivative of the area ratio: J (g_Ii g_Jj - g_Ij g_Ji), and of J with that of the stretch around
        crossed = np.einsum("eij,ekl->eilkj", flat, flat).reshape(elements, nodes * self.dim, nodes * self.dim)
        if self.hoop is not None:
            crossed += _squares(outward)
        local = (acting * jacobian)[:, None, None] * (_squares(by) - crossed)
        rows = np.broadcast_to(self._dofs[:, :, None], local.shape).ravel()
        columns = np.broadcast_to(self._dofs[:, None, :], local.shape).ravel()
        pointer = np.arange(elements + 1) * nodes * self.dim
        to_volume = csr_matrix((slope.ravel(), self._dofs.ravel(), pointer), shape=(elements, len(u)))
        ratio = self.share @ to_volume
        coupled = (ratio.T @ diags(bulk / self.patch) @ ratio).tocoo()
        return Contribution(
            force,
            np.concatenate([rows, coupled.row]),
            np.concatenate([columns, coupled.col]),
            np.concatenate([local.ravel(), coupled.data]),
        )


def _squares(values: np.ndarray) -> np.ndarray:
    """Products of all values of an element with each other, shape (elements, values, values)."""
    flat = values.reshape(len(values), -1)
    return np.asarray(flat[:, :, None] * flat[:, None, :])
