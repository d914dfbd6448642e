"""Whether a finer mesh that a study brings is one of the same body: its layers, its sets, its size and its place."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.mesh.mesh import Mesh

_INTERNAL = "_"
"""ABAQUS/CAE begins the names of sets with it that no person gave."""
_ROUNDING = 1e-6
"""Of coordinates in files, as a share of an extent: those of an ABAQUS deck have seven digits or more."""


def other_body(mesh: Mesh, finer: Mesh, layers: list[str], where: Path, other: Path) -> list[FingerfitError]:
    """What of a finer mesh is not that of the mesh of the search.

    However a mesh follows a body, on its borders or by whole elements, as those of voxels do, it comes within one of
    its elements of it, but where the body is thinner than that. So along each axis the finer mesh may end one element
    further in, and further out than that with what is thinner than an element. Node sets may have any size, since
    people choose them by rows of nodes: they are in the same place.

    Parameters
    ----------
    mesh, finer : Mesh
        In mm, with the sets of the study.
    layers : list of str
        Element sets of the layers.
    where, other : Path
        File of the finer mesh, which errors name, and that of the mesh.
    """
    if finer.dim != mesh.dim:
        return [InputError(where, "mesh", f"{finer.dim} dimensions", f"{mesh.dim}, as {other.name} has")]
    if len(finer.points) < len(mesh.points):
        found = f"{len(finer.points)} nodes, fewer than the {len(mesh.points)} of {other.name}"
        return [InputError(where, "mesh", found, "a finer mesh of the same body")]
    problems: list[FingerfitError] = list(_other_sets(mesh, finer, where, other))
    outside = [one.element_count - len(_elements(one, layers)) for one in (mesh, finer)]
    if outside[1] and not outside[0]:
        found = f"{outside[1]} of {finer.element_count} in no layer of the study"
        problems.append(InputError(where, "elements", found, f"layers for all of them, as in {other.name}"))
    if told := _elsewhere(mesh, finer, "", "", other):
        return [*problems, InputError(where, "nodes", *told)]
    known = set[tuple[str, str]]()  # a set may have two names: its own, and that of a layer
    for kind in ("element_sets", "node_sets"):
        for name in sorted(set(getattr(mesh, kind)) & set(getattr(finer, kind))):
            if (kind, name) == ("node_sets", "INDENTER") and all(map(_any_node, (mesh, finer))):
                continue
            told = _elsewhere(mesh, finer, kind, name, other)
            if told is not None and told not in known:
                known.add(told)
                problems.append(InputError(where, f"{kind.removesuffix('s').replace('_', ' ')} {name}", *told))
    return problems


def _other_sets(mesh: Mesh, finer: Mesh, where: Path, other: Path) -> Iterator[InputError]:
    """Sets that the finer mesh lacks: a deck may name them."""
    for kind in ("element_sets", "node_sets", "surfaces"):
        names = set(getattr(mesh, kind)) - set(getattr(finer, kind)) - {"ALL"}  # that of all nodes every deck has
        if lacking := sorted(name for name in names if name[0] != _INTERNAL):
            what = kind.replace("_", " ")
            yield InputError(where, what, f"no {', '.join(lacking)}", f"the {what} of {other.name}")


def _any_node(mesh: Mesh) -> bool:
    """Whether the node of the indenter is one of its face: any of them stands for all."""
    return bool(np.isin(mesh.node_sets["INDENTER"], mesh.node_sets["TOP"]).all())


def _elements(mesh: Mesh, sets: list[str]) -> np.ndarray:
    """Elements of some sets."""
    return np.unique(np.concatenate([mesh.element_sets[name] for name in sets]))


def _nodes(mesh: Mesh, kind: str, name: str) -> np.ndarray:
    """Nodes of a set, or of all elements where no kind of sets is named."""
    if kind == "node_sets":
        return np.unique(mesh.node_sets[name])
    return mesh.nodes_of(mesh.element_sets[name] if kind else np.arange(mesh.element_count))


def _elsewhere(mesh: Mesh, finer: Mesh, kind: str, name: str, other: Path) -> tuple[str, str] | None:
    """Where a set of the finer mesh lies, and where it should, in words; None where it does."""
    meshes = (mesh, finer)
    nodes = [_nodes(one, kind, name) for one in meshes]
    if not all(map(len, nodes)):
        return None
    own, its = (one.points[which] for one, which in zip(meshes, nodes, strict=True))
    element = np.max([_largest(one, which) for one, which in zip(meshes, nodes, strict=True)], axis=0)
    slack = element + _ROUNDING * np.ptp(mesh.points, axis=0).max()
    if kind == "node_sets":
        wrong = bool(((_gap(own, its) > slack) | (_gap(its, own) > slack)).any())
    else:
        wrong = _ends_inside(own, its, slack) or _thick_beyond(own, its, slack)
    if not wrong:
        return None
    within = " x ".join(f"{size:.3g}" for size in element)
    return _words(its), f"{_words(own)}, as in {other.name}, to one element ({within} mm)"


def _gap(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """How far beyond the first points the other ones begin, along each axis."""
    return np.asarray(other.min(axis=0) - one.max(axis=0))


def _ends_inside(own: np.ndarray, its: np.ndarray, slack: np.ndarray) -> bool:
    """Whether points end further in than others, by more than allowed."""
    return bool(((its.min(axis=0) - own.min(axis=0) > slack) | (own.max(axis=0) - its.max(axis=0) > slack)).any())


def _thick_beyond(own: np.ndarray, its: np.ndarray, slack: np.ndarray) -> bool:
    """Whether points end further out than others, with what is along no other axis thinner than allowed."""
    for axis in range(own.shape[1]):
        out = np.maximum(own[:, axis].min() - its[:, axis], its[:, axis] - own[:, axis].max())
        beyond = its[out > slack[axis]]
        if len(beyond) and (np.delete(np.ptp(beyond, axis=0) - slack, axis) > 0).all():
            return True
    return False


def _largest(mesh: Mesh, nodes: np.ndarray) -> np.ndarray:
    """Largest extent along each axis of the elements that some nodes belong to; of nodes of none that of all."""
    there = np.zeros(len(mesh.points), dtype=bool)
    there[nodes] = True
    sizes = [(np.ptp(mesh.points[block.nodes], axis=1), there[block.nodes].any(axis=1)) for block in mesh.blocks]
    touched = [size[at] for size, at in sizes if at.any()] or [size for size, _ in sizes]
    return np.asarray(np.concatenate(touched).max(axis=0))


def _words(points: np.ndarray) -> str:
    """Extents along the axes.

    >>> _words(np.array([[0.0, -6.0], [12.0, 6.5]]))
    'x 0 to 12, y -6 to 6.5 mm'
    """
    ends = zip("xyz", points.min(axis=0), points.max(axis=0), strict=False)
    return ", ".join(f"{axis} {low:.4g} to {high:.4g}" for axis, low, high in ends) + " mm"
