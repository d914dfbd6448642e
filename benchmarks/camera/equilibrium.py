"""Equilibrium of a block under a plate, step by step, at large strain.

The displacement is quadratic on each element, the pressure linear on each element and eliminated there. Newton's method
with halved steps. Forces are per mm of thickness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
import scipy.sparse.linalg as sparse_linalg
from block import Block
from ogden import SECOND_DERIVATIVE_OF_J, bulk_modulus, cofactor, determinant, deviatoric

AddedStress = Callable[[np.ndarray, Block], np.ndarray]
"""Stress (MPa) beyond that of the law, of the deformation gradients and the block."""
Plate = Callable[[float], np.ndarray]
"""Displacements (nodes of the top, 2) in mm, of the indentation in mm."""
ITERATIONS = 14
SMALLEST_STEP = 1e-4
"""Share of the height below which a step is given up."""
SMALLEST_VOLUME = 0.05
"""Ratio of volumes J below which a trial is given up."""
DIFFERENCE = 1e-6
"""Change of F that the tangent of an added stress is computed with."""


class NoEquilibriumError(RuntimeError):
    """No equilibrium was found, with the smallest steps either."""


@dataclass
class Hold:
    """How the base is held: two masks over the nodes of the bottom, and springs that act sideways.

    Parameters
    ----------
    sideways, upwards : ndarray of bool
        Nodes that cannot move sideways, and upwards.
    springs : ndarray or None
        Stiffness of a spring at each node, N/mm per mm of thickness.
    """

    sideways: np.ndarray
    upwards: np.ndarray
    springs: np.ndarray | None = None


class Solver:
    """A block with its material and its hold.

    Parameters
    ----------
    block : Block
        The mesh.
    modulus : ndarray (elements, 9)
        Shear modulus at each integration point, MPa.
    alpha, poisson : float
        Exponent and Poisson ratio.
    added_stress : callable or None
        Stress beyond that of the law; its tangent is computed by differences.
    hold : Hold or None
        How the base is held; None is glued.
    """

    def __init__(
        self,
        block: Block,
        modulus: np.ndarray,
        alpha: float,
        poisson: float,
        added_stress: AddedStress | None = None,
        hold: Hold | None = None,
    ) -> None:
        self.block, self.modulus, self.alpha = block, modulus, np.float64(alpha)
        self.added_stress = added_stress
        weights = block.volumes / bulk_modulus(modulus, poisson)
        compliance = np.einsum("qa,qb,eq->eab", block.pressures, block.pressures, weights)
        self.pressure_stiffness = np.linalg.inv(compliance)
        everywhere = np.ones(len(block.bottom), bool)
        self.hold = hold or Hold(everywhere, everywhere)
        self.held = np.concatenate([2 * block.bottom[self.hold.sideways], 2 * block.bottom[self.hold.upwards] + 1])

    def assemble(self, u: np.ndarray) -> tuple[np.ndarray, sparse.csc_matrix]:
        """Forces at all degrees of freedom for displacements u (mm), and their derivative."""
        block = self.block
        count = len(block.elements)
        F = np.eye(2) + np.einsum("eai,eqaj->eqij", u.reshape(-1, 2)[block.elements], block.gradients)
        J = determinant(F)
        if J.min() <= SMALLEST_VOLUME:
            raise FloatingPointError
        stress, tangent = self._without_pressure(F)
        H = cofactor(F)
        dilation = np.einsum("qa,eq->ea", block.pressures, (J - 1) * block.volumes)
        pressure = np.einsum("eab,eb->ea", self.pressure_stiffness, dilation)
        at_points = pressure @ block.pressures.T
        stress = stress + at_points[..., None, None] * H
        tangent = tangent + at_points[..., None, None, None, None] * SECOND_DERIVATIVE_OF_J
        tangent = tangent.reshape(count, 9, 4, 4) * block.volumes[..., None, None]
        forces = np.einsum("eqij,eq,eqaj->eai", stress, block.volumes, block.gradients).reshape(count, 18)
        stiffness = np.matmul(
            block.strain.reshape(count, 36, 18).swapaxes(1, 2),
            np.matmul(tangent, block.strain).reshape(count, 36, 18),
        )
        coupling = np.einsum(
            "eqkd,eqk,qa->eda",
            block.strain,
            H.reshape(count, 9, 4) * block.volumes[..., None],
            block.pressures,
            optimize=True,
        )
        stiffness = stiffness + np.matmul(np.matmul(coupling, self.pressure_stiffness), coupling.swapaxes(1, 2))
        return self._summed(u, forces, stiffness)

    def _without_pressure(self, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Stress and tangent of the law's deviatoric part, and of what is added to it."""
        stress, tangent = deviatoric(F, self.modulus, self.alpha)
        if self.added_stress is None:
            return stress, tangent
        stress = stress + self.added_stress(F, self.block)
        for i in range(2):
            for j in range(2):
                near = F.copy()
                near[..., i, j] += DIFFERENCE
                more = self.added_stress(near, self.block)
                near[..., i, j] -= 2 * DIFFERENCE
                tangent[..., i, j] += (more - self.added_stress(near, self.block)) / (2 * DIFFERENCE)
        return stress, tangent

    def _summed(self, u: np.ndarray, forces: np.ndarray, stiffness: np.ndarray) -> tuple[np.ndarray, sparse.csc_matrix]:
        """Sum over the elements, and the springs of the base."""
        block = self.block
        size = (block.dof_count, block.dof_count)
        residual = np.zeros(block.dof_count)
        np.add.at(residual, block.dofs.ravel(), forces.ravel())
        places = (block.matrix_rows, block.matrix_columns)
        matrix = sparse.coo_matrix((stiffness.ravel(), places), shape=size).tocsc()
        springs = self.hold.springs
        if springs is not None:
            dofs = 2 * block.bottom
            residual[dofs] += springs * u[dofs]
            matrix = matrix + sparse.coo_matrix((springs, (dofs, dofs)), shape=size).tocsc()
        return residual, matrix

    def run(
        self, indentations: Iterable[float], plate: Plate, sliding: bool = False, tolerance: float = 1e-7
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Solve one indentation after the other.

        Parameters
        ----------
        indentations : iterable of float
            Indentations, mm.
        plate : callable
            Displacements of the top at an indentation.
        sliding : bool
            Whether the top slides along the plate; else it is glued.
        tolerance : float
            Largest unbalanced force over the largest force of a support.

        Returns
        -------
        moved : list of ndarray (nodes, 2)
            Displacements at each indentation, mm.
        force : ndarray (steps,)
            Force at the plate, N per mm of thickness, positive in compression.
        """
        top = 2 * self.block.top
        pressed = [top + 1] if sliding else [top, top + 1]
        fixed = np.concatenate([self.held, *pressed])
        state = np.zeros(self.block.dof_count)
        history = [(0.0, state.copy())]
        moved, forces = [], []
        force = 0.0
        for wanted in indentations:
            now = history[-1][0]
            step = wanted - now
            while abs(wanted - now) > 1e-12:
                goal = wanted if abs(step) >= abs(wanted - now) * 0.999 else now + step
                guess = _continued(history, goal)
                found = self._newton(guess, plate(goal), len(history) == 1, fixed, sliding, tolerance)
                if found is None:
                    step = (goal - now) / 2
                    if abs(step) < SMALLEST_STEP * self.block.height:
                        raise NoEquilibriumError(f"no equilibrium at an indentation of {goal:g} mm")
                    continue
                state, residual = found
                now, force = goal, -residual[top + 1].sum()
                history = [*history, (now, state.copy())][-2:]
            moved.append(state.reshape(-1, 2).copy())
            forces.append(force)
        return moved, np.array(forces)

    def _newton(
        self, v: np.ndarray, pressed: np.ndarray, first: bool, fixed: np.ndarray, sliding: bool, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Displacements in equilibrium and the forces there, from a guess; None where Newton's method fails.

        The first step begins with the linear answer to the plate's whole motion.
        """
        top = 2 * self.block.top
        free = np.setdiff1d(np.arange(self.block.dof_count), fixed)
        if not first:
            v[top + 1] = pressed[:, 1]
            if not sliding:
                v[top] = pressed[:, 0]
        try:
            for iteration in range(ITERATIONS):
                residual, matrix = self.assemble(v)
                if first and iteration == 0:
                    motion = np.zeros(self.block.dof_count)
                    motion[top + 1] = pressed[:, 1] - v[top + 1]
                    if not sliding:
                        motion[top] = pressed[:, 0] - v[top]
                    v = v + motion
                    v[free] += _solved(matrix, free, -(residual + matrix @ motion)[free])
                    continue
                left = np.abs(residual[free]).max() / np.abs(residual[fixed]).max()
                if left < tolerance:
                    return v, residual
                if not np.isfinite(left) or (iteration > 5 and left > 1e3):
                    return None
                v[free] += _solved(matrix, free, -residual[free])
        except (FloatingPointError, RuntimeError):  # an element turns inside out, or the matrix is singular
            return None
        return None


def _continued(history: list[tuple[float, np.ndarray]], goal: float) -> np.ndarray:
    """The last two states continued in a straight line to an indentation."""
    now, state = history[-1]
    if len(history) > 1 and abs(now - history[-2][0]) > 1e-9:
        before, earlier = history[-2]
        return state + (goal - now) / (now - before) * (state - earlier)
    return state.copy()


def _solved(matrix: sparse.csc_matrix, free: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Solve for the free degrees of freedom."""
    factors = sparse_linalg.splu(
        matrix[free][:, free],
        permc_spec="MMD_AT_PLUS_A",
        options={"SymmetricMode": True},
        diag_pivot_thresh=0.0,
    )
    return factors.solve(forces)
