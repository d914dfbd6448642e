"""From points of space to local coordinates of elements: Newton's method on the element's own polynomial."""

from __future__ import annotations

from functools import cache, reduce
from itertools import product

import numpy as np

from fingerfit.mesh.elements import ELEMENTS, distance, middle, shape

_ITERATIONS = 12
"""Of Newton's method, which is quadratic near the end; a choice."""
_FAR = 3.0
"""Depth, 0 in an element's middle and 1 on its border, beyond which a point is taken to be in another element; a
choice."""
_CONVERGED = 1e-3
"""Length of the last move in local coordinates: what is left is of the order of its square, 1e-6 of an element."""

_FLAT = 1e-12
"""Determinant of the derivatives, relative to the product of their lengths, down to which an element is flat."""

_QUADRATIC: dict[int, list[tuple[int, ...]]] = {
    2: [(2, 0), (1, 1), (0, 2)],
    3: [(2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1)],
}


def _exponents(dim: int, nodes: int) -> list[tuple[int, ...]]:
    """Monomials that an element's shape functions are made of."""
    linear: list[tuple[int, ...]] = [tuple(int(i == axis) for i in range(dim)) for axis in range(-1, dim)]
    if nodes == dim + 1:
        return linear
    if nodes == 2**dim:
        return list(product((0, 1), repeat=dim))
    if nodes == (dim + 1) * (dim + 2) // 2:
        return linear + _QUADRATIC[dim]
    # serendipity: at most one square, times the other coordinates to the first power
    return [e for e in product((0, 1, 2), repeat=dim) if e.count(2) <= 1]


@cache
def _polynomial(kind: str) -> tuple[tuple[tuple[int, ...], ...], np.ndarray]:
    """Exponents of the monomials and their coefficients by node, shape (monomials, nodes)."""
    element = ELEMENTS[kind]
    exponents = _exponents(element.dim, element.nodes)
    points = np.array(list(product((0.0, 0.3, 0.7), repeat=element.dim)))
    monomials = np.stack([np.prod(points ** np.array(e), axis=1) for e in exponents], axis=1)
    coefficients = np.linalg.lstsq(monomials, shape(kind, points)[0], rcond=None)[0]
    return tuple(exponents), coefficients


def _evaluate(
    exponents: tuple[tuple[int, ...], ...], coefficients: np.ndarray, xi: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions, shape (dim, pairs), and their derivatives, shape (local axis, dim, pairs).

    `coefficients` has shape (monomials, dim, pairs), `xi` (dim, pairs).
    """
    dim = len(xi)
    powers = [np.ones_like(xi), xi, xi * xi]
    value = np.zeros_like(coefficients[0])
    slope = np.zeros((dim, *value.shape))
    for e, c in zip(exponents, coefficients, strict=True):
        value += _monomial(powers, e) * c
        for axis in range(dim):
            if e[axis]:
                lower = tuple(p - (k == axis) for k, p in enumerate(e))
                slope[axis] += e[axis] * _monomial(powers, lower) * c
    return value, slope


def _monomial(powers: list[np.ndarray], e: tuple[int, ...]) -> np.ndarray | float:
    factors = [powers[p][axis] for axis, p in enumerate(e) if p]
    return reduce(np.multiply, factors) if factors else 1.0


def interpolate(kind: str, values: np.ndarray, element: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Values at local points, shape (points, dim), of those at the elements' nodes, shape (elements, nodes, dim)."""
    exponents, by_node = _polynomial(kind)
    coefficients = np.take(np.einsum("mn,eni->mie", by_node, values), element, axis=2)
    powers = [np.ones_like(xi.T), xi.T, xi.T * xi.T]
    total = np.zeros((values.shape[2], len(xi)))
    for e, c in zip(exponents, coefficients, strict=True):
        total += _monomial(powers, e) * c
    return total.T


def bulge(kind: str, corners: np.ndarray) -> np.ndarray:
    """How far elements may reach beyond the box around their nodes, shape (elements, dim)."""
    element = ELEMENTS[kind]
    exponents, by_node = _polynomial(kind)
    # terms that are straight along an edge, as xy of a quadrilateral, stay within the box
    curved = [max(e) > 1 or (element.is_simplex and sum(e) > 1) for e in exponents]
    return np.abs(np.einsum("mn,eni->emi", by_node[curved], corners)).sum(axis=1)


def local_coordinates(
    kind: str, corners: np.ndarray, element: np.ndarray, target: np.ndarray, reach: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Local coordinates of points in elements that may hold them.

    Parameters
    ----------
    kind : str
        Element type.
    corners : ndarray, shape (elements, nodes, dim)
        Positions of the nodes.
    element : ndarray of int, shape (pairs,)
    target : ndarray, shape (pairs, dim)
        Points, in the unit of `corners`.
    reach : float
        How far outside the element points still count, in that unit, to first order.

    Returns
    -------
    xi : ndarray, shape (pairs, dim)
    outside : ndarray, shape (pairs,)
        Distance from the element: 0 inside, infinite for points out of reach or without a solution.
    """
    exponents, by_node = _polynomial(kind)
    polynomial = np.einsum("mn,eni->mie", by_node, corners)
    dim, pairs = corners.shape[2], len(target)
    xi, outside = np.empty((dim, pairs)), np.full(pairs, np.inf)
    # the first move starts in the middle, where position and slope are the element's, not the pair's
    centre = np.tile(middle(kind)[:, None], (1, len(corners)))
    value, slope = _evaluate(exponents, polynomial, centre)
    move, det = _solve(np.take(slope, element, axis=-1), np.take(value, element, axis=-1), target.T)
    at = np.clip(move, -1.0, 1.0) + centre[:, :1]
    active = np.flatnonzero((distance(kind, at.T) < _FAR) & (det != 0))
    c, goal, at = np.take(polynomial, element[active], axis=2), target.T[:, active], at[:, active]
    for _ in range(_ITERATIONS):
        if not len(active):
            break
        value, slope = _evaluate(exponents, c, at)
        move, det = _solve(slope, value, goal)
        at += np.clip(move, -1.0, 1.0)
        depth = distance(kind, at.T)
        done = np.abs(move).max(axis=0) < _CONVERGED
        if done.any():
            found = active[done]
            xi[:, found] = at[:, done]
            outside[found] = _outside(depth[done], at[:, done], slope[:, :, done], det[done], kind)
        going = ~done & (depth < _FAR) & (det != 0)
        if reach == 0.0:
            # Newton's method is quadratic near the end: who is farther out than that stays outside
            last = np.abs(move).max(axis=0)
            going &= (depth < 1.0 + 2.0 * last) | (last > 0.5)
        going = np.flatnonzero(going)
        active, c, goal, at = active[going], np.take(c, going, axis=2), goal[:, going], at[:, going]
    outside[outside > reach] = np.inf
    return xi.T, outside


def _outside(depth: np.ndarray, xi: np.ndarray, slope: np.ndarray, det: np.ndarray, kind: str) -> np.ndarray:
    """Distance of points from their element, to first order: what they are too far out by over its gradient."""
    found = np.where(det != 0, 0.0, np.inf)
    far = np.flatnonzero((depth > 1.0 + 2 * _CONVERGED**2) & (det != 0))
    if len(far):
        step = 1e-6
        dim = len(xi)
        gradient = np.stack(
            [
                (distance(kind, (xi[:, far] + step * np.eye(dim)[:, [axis]]).T) - depth[far]) / step
                for axis in range(dim)
            ]
        )
        inverse = np.linalg.inv(slope[:, :, far].transpose(2, 1, 0))
        in_space = np.einsum("ap,pai->pi", gradient, inverse)
        # where the distance has no slope the point may be anywhere: infinitely far
        with np.errstate(divide="ignore"):
            found[far] = (depth[far] - 1.0) / np.linalg.norm(in_space, axis=1)
    return found


def _solve(slope: np.ndarray, value: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps from `value` to `goal`, shape (dim, pairs), and the determinants; zero where these vanish."""
    right = goal - value
    if len(right) == 2:
        (a, c), (b, d) = slope
        det = a * d - b * c
        move = np.stack([d * right[0] - b * right[1], a * right[1] - c * right[0]])
    else:
        crosses = [np.cross(slope[k - 2], slope[k - 1], axis=0) for k in range(3)]
        det = (slope[0] * crosses[0]).sum(axis=0)
        move = np.stack([(right * cross).sum(axis=0) for cross in crosses])
    det = np.where(np.abs(det) > _FLAT * np.prod(np.abs(slope).sum(axis=1), axis=0), det, 0.0)
    return np.divide(move, det, out=np.zeros_like(move), where=det != 0), det
