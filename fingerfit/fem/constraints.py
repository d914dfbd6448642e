"""Ties between degrees of freedom, resolved so that no master is a slave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np


def resolve(
    ties: Mapping[int, Sequence[tuple[int, float]]], prescribed: np.ndarray, turning: Sequence[int] = ()
) -> dict[int, list[tuple[int, float]]]:
    """Ties whose masters are not slaves.

    Parameters
    ----------
    ties : mapping
        Slave to its masters with factors; masters may be slaves of others.
    prescribed : ndarray of bool, shape (size,)
        Degrees of freedom with a given displacement.
    turning : sequence of int
        Those of nodes that turn with a rigid body.

    Raises
    ------
    ValueError
        When ties go round in a circle, a slave or one that turns is prescribed, or one that turns is tied; the argument
        is the degree of freedom.
    """
    if set(turning) & set(ties):
        raise ValueError(min(set(turning) & set(ties)))
    for dof in turning:
        if prescribed[dof]:
            raise ValueError(dof)
    done: dict[int, list[tuple[int, float]]] = {}

    def visit(slave: int, way: tuple[int, ...]) -> list[tuple[int, float]]:
        if slave in done:
            return done[slave]
        if slave in way or prescribed[slave]:
            raise ValueError(slave)
        total: dict[int, float] = {}
        for master, factor in ties[slave]:
            parts = visit(master, (*way, slave)) if master in ties else [(master, 1.0)]
            for end, share in parts:
                total[end] = total.get(end, 0.0) + factor * share
        done[slave] = [(end, value) for end, value in total.items() if value != 0.0]
        return done[slave]

    for slave in ties:
        visit(slave, ())
    for slave, masters in done.items():
        if {master for master, _ in masters} & set(turning):
            raise ValueError(slave)
    return done
