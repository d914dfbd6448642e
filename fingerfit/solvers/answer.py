"""Whether what a program left behind is a whole answer to its deck: adapters ask before they hand it on.

A guess without equilibrium is an answer and is kept. A damaged result is none: it would be kept for good, as converged
or as *no equilibrium*, and the search would go on with it. So it stops with one line, and the next run solves the deck
again.
"""

from __future__ import annotations

import signal
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from fingerfit.core.errors import SolverError
from fingerfit.core.processes import perhaps_memory
from fingerfit.deck.content import Deck, DeckStep
from fingerfit.solvers.contract import Outcome

DIGITS = 1e-6
"""Relative error of a number that is written with seven digits, as in CalculiX's .dat; ABAQUS writes more."""


def by_node(
    labels: Sequence[int], values: np.ndarray, index: Mapping[int, int], needed: Collection[int], what: str
) -> np.ndarray:
    """A table of results in the order of the deck's nodes.

    Parameters
    ----------
    labels : sequence of int
        Nodes as the program calls them, one for each row.
    values : ndarray, shape (rows, components)
        mm or N.
    index : mapping
        Label to number of the node, from 0.
    needed : collection of int
        Numbers of the nodes that must be there.
    what : str
        Solver, deck and table, for the message.

    Returns
    -------
    ndarray, shape (nodes, components)
        0 at nodes that are neither needed nor there.

    Raises
    ------
    SolverError
        For a node that the deck does not have, that is there twice or not at all, and for values that are not finite.
    """
    found = np.zeros((max(index.values()) + 1, values.shape[1]))
    seen: set[int] = set()
    for label, row in zip(labels, values, strict=True):
        node = index.get(label)
        if node is None:
            raise SolverError(f"{what}: damaged: node {label}, which the deck does not have")
        if node in seen:
            raise SolverError(f"{what}: damaged: node {label} twice")
        if not np.isfinite(row).all():
            numbers = " ".join(f"{x:g}" for x in row)
            raise SolverError(f"{what}: damaged: node {label} has {numbers}, which is not finite")
        seen.add(node)
        found[node] = row
    absent = set(needed) - seen
    lost = sorted(label for label, node in index.items() if node in absent)
    if lost:
        raise SolverError(f"{what}: damaged: {len(lost)} of {len(needed)} nodes are missing, the first is {lost[0]}")
    return found


def counted_steps(deck: Deck) -> list[DeckStep]:
    """The steps whose end is a result: all, or those from the first on that prints the nodes ALL."""
    return [step for step in deck.steps if step.printed] or list(deck.steps)


def verify(outcome: Outcome, deck: Deck, what: str) -> Outcome:
    """The outcome, if it can be an answer to its deck.

    Parameters
    ----------
    outcome : Outcome
    deck : Deck
    what : str
        Solver and deck, for the message.

    Raises
    ------
    SolverError
        When a displacement that the deck prescribes has another value, or one is so large that the size of the body is
        lost in its digits.
    """
    size = float(np.ptp(deck.mesh.points, axis=0).max())
    for number, (step, moved) in enumerate(zip(counted_steps(deck), outcome.displacement, strict=False), 1):
        largest = np.abs(moved).max(initial=0.0)
        # strains are differences of displacements: beyond this seven digits hold none
        if largest > size / DIGITS:
            node = int(np.unravel_index(np.abs(moved).argmax(), moved.shape)[0])
            label = deck.labels[node][1]
            raise SolverError(
                f"{what}: damaged: node {label} of a body of {size:.4g} mm moved by {largest:.4g} mm in result {number}"
            )
        follows = {key for kind, key in step.curve if kind == "U"} | step.kept
        given = {key: value for key, value in step.displacement.items() if key not in follows}
        off = DIGITS * max([size, *map(abs, given.values())])
        for (node, axis), value in given.items():
            if node < len(moved) and axis < moved.shape[1] and abs(moved[node, axis] - value) > off:
                label, found = deck.labels[node][1], moved[node, axis]
                raise SolverError(
                    f"{what}: damaged: node {label} moved by {found:.6g} mm along axis {axis + 1} in result {number};"
                    f" the deck prescribes {value:.6g} mm"
                )
    return outcome


def check_balance(
    forces: np.ndarray, deck: Deck, moved: np.ndarray, slack: float, what: str, applied: bool = False
) -> None:
    """Refuse nodal forces that do not balance along the last axis: in axisymmetry the only one along which they do.

    The forces inside a body add up to nothing, reactions to what is applied; grounded springs hold the rest. Not asked
    of decks with contact, whose tools may have forces that are not in the table, nor with equations that are levers.

    Parameters
    ----------
    forces, moved : ndarray, shape (nodes, dim)
        N and mm.
    deck : Deck
    slack : float
        Share of the sum of sizes that may be left over: residual of the solver or digits of the table.
    applied : bool
        Whether these are reactions: then what the deck applies may be left over.
    what : str
        Solver, deck and table, for the message.

    Raises
    ------
    SolverError
        When they do not.
    """
    alike = all(
        len({axis for _, axis, _ in terms}) == 1 and abs(sum(factor for *_, factor in terms)) < DIGITS
        for terms in deck.equations
    )
    if deck.contacts or deck.rigid or not alike:
        return
    axis = forces.shape[1] - 1
    sizes = float(np.abs(forces[:, axis]).sum())
    held = sum(
        abs(spring.force(moved[spring.first[0], axis]))
        for spring in deck.springs
        if spring.second is None and spring.first[1] == axis
    )
    if applied:
        held += max(sum(abs(f) for (_, along), f in step.force.items() if along == axis) for step in deck.steps)
    left = abs(float(forces[:, axis].sum()))
    if left > slack * (sizes + held) + held:
        raise SolverError(f"{what}: damaged: nodal forces of {sizes:.4g} N in all leave {left:.4g} N without balance")


def ended(code: int) -> str:
    """How a program ended, in words."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"ended by {signal.Signals(-code).name}{perhaps_memory(-code)}"
    except ValueError:
        return f"ended by signal {-code}"
