"""Following a loading path: increments, what is predicted for the next one, and cuts of those that fail."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fingerfit.fem.factor import inner
from fingerfit.fem.newton import TOLERANCE, Load, Newton, State
from fingerfit.fem.system import System

_BEND = 0.5
"""Share of the curvature that a prediction takes on: all of it goes too far where the body gives way suddenly, and took
more iterations (docs/decisions/0002-numpy-kernels.md)."""
_ROUGH = 1e-2
"""Residual, relative to the largest internal force, that is enough before the end of a step where contact opens and
closes without friction: the path does not matter there (docs/decisions/0006-large-systems.md)."""
_HERTZ = 2.0 / 3.0
"""Power of the force with which a round body goes deeper (Hertz 1882; docs/decisions/0006-large-systems.md)."""
_KEEP = 2
"""Increments of the same length after one that failed, before the next one is twice as long; a choice."""
CUTS = 7
"""How often an increment is halved at most, down to 1/128 of a step (docs/solver.md); a choice."""


@dataclass(frozen=True)
class Increments:
    """How a step is gone through.

    Parameters
    ----------
    first, largest : float
        First and largest increment as shares of the step.
    fixed : bool
        Whether all have the length of the first; a step that does not converge then is not cut.
    period : float
        Length of the step, s.
    viscous : bool
        Whether time passes for materials that relax; else they answer as to a fast load.
    relaxed : bool
        Whether they answer as to an infinitely slow load.
    stops : tuple of float
        Shares of the step at which an increment ends.
    """

    first: float = 1.0
    largest: float = 1.0
    fixed: bool = False
    period: float = 1.0
    viscous: bool = False
    relaxed: bool = False
    stops: tuple[float, ...] = ()


class LoadPath:
    """Follows a loading path.

    Parameters
    ----------
    system : System
        Elements and constraints.
    floor : float
        N; residuals below `TOLERANCE` times this are none, for bodies that come to rest without any force.
    """

    def __init__(self, system: System, floor: float = 0.0) -> None:
        self._newton = Newton(system, max(floor, 1e-300))
        zero = np.zeros(system.size)
        self.state = State(np.zeros(len(system.free)), zero, zero)
        self.load = Load(zero, zero)
        self._before: tuple[State, Load] | None = None
        self._earlier: tuple[State, Load] | None = None
        self._pace: float | None = None  # length of the last increments of a step that was hard, as of `Load.away`

    @property
    def system(self) -> System:
        """Elements and constraints at present."""
        return self._newton.system

    def change(self, system: System) -> None:
        """Go on with other constraints, from the present displacements."""
        self._newton = Newton(system, self._newton.floor)
        self.state = State(self.state.u[system.free], self.state.u, self.state.internal)
        self.load = Load(np.where(system.prescribed, self.state.u, 0.0), self.load.force)
        self._before = self._earlier = None

    def advance(
        self,
        target: Load | Callable[[float], Load],
        increments: Increments | float = 1.0,
        watch: Callable[[float, float, np.ndarray], None] | None = None,
    ) -> tuple[bool, int]:
        """Go to a load, in one increment or as many as it needs.

        Parameters
        ----------
        target : Load, or function of the share of the step
            A load is approached on a straight line.
        increments : Increments or float
            A number is the first increment.
        watch : function, optional
            Called at the end of each increment, before it is taken into the history: share of the step, length in s (0
            where no time passes), and displacements, shape (size,), mm.

        Returns
        -------
        arrived : bool
        iterations : int
        """
        how = increments if isinstance(increments, Increments) else Increments(first=increments)
        path = _line(self.load, target) if isinstance(target, Load) else target
        share, size, total = 0.0, min(how.first, how.largest), 0
        length = float(np.linalg.norm(path(1.0).away(self.load)))
        if self._pace is not None and not how.fixed and length > 0:
            size = min(size, max(self._pace / length, 0.5**CUTS))
        smallest, failed, keep = min(0.5**CUTS * how.largest, size / 8), False, 0
        while share < 1.0:
            end = min([1.0, share + size, *(stop for stop in how.stops if share + 1e-9 < stop < share + size)])
            if end > 1 - 1e-9:
                end = 1.0
            dt = (end - share) * how.period if how.viscous else 0.0
            self.system.begin(dt, how.relaxed)
            load = path(end)
            # on the way, where the path does not matter, near an equilibrium is enough
            rough = end < 1.0 and self.system.slides and not (self.system.remembers or how.viscous)
            state, used = self._newton.equilibrium(
                self.state, self.load, load, self._predict(load), _ROUGH if rough else TOLERANCE
            )
            total += used
            if state is None:
                size = min(size, end - share) / 2
                if size < smallest or how.fixed:
                    return False, total
                failed, keep = True, _KEEP
                continue
            if watch is not None:
                watch(end, dt, state.u)
            self.system.settle(state.u)
            self.system.commit(state.u, dt, how.relaxed)
            self._earlier, self._before = self._before, (self.state, self.load)
            self.state, self.load, share = state, load, end
            # with friction, an increment fails for what begins to slip in it, not for what comes after
            if failed and self.system.slides and not self.system.remembers:
                self._pace = size * length
            keep -= 1
            size = how.first if how.fixed else min(size if keep > 0 else 2 * size, how.largest)
        return True, total

    def jump(self, load: Load, u: np.ndarray, relaxed: bool = False) -> tuple[bool, int]:
        """Go to a load in one increment from displacements nearby, where the path does not matter.

        Where that finds no equilibrium, all is as before.

        Parameters
        ----------
        load : Load
        u : ndarray, shape (size,)
            Displacements close to the equilibrium, mm.
        relaxed : bool
            As of `Increments`.

        Returns
        -------
        arrived : bool
        iterations : int
        """
        self.system.begin(0.0, relaxed)
        state, used = self._newton.equilibrium(self.state, self.load, load, u[self.system.free], TOLERANCE)
        if state is None:
            return False, used
        self.system.settle(state.u)
        self.system.commit(state.u, 0.0, relaxed)
        self._earlier, self._before = self._before, (self.state, self.load)
        self.state, self.load = state, load
        return True, used

    def _predict(self, load: Load) -> np.ndarray | None:
        """Unknowns continued on the curve through the last states; None where there is only one."""
        if self._before is None:
            return None
        (before, first), last = self._before, self.load
        done = last.away(first)
        length = inner(done, done)
        if length == 0:
            return None
        ahead, slope = inner(done, load.away(last)) / length, self.state.q - before.q
        if self.system.driven:
            # a round body goes deeper with a power of the force
            begun, now, then = (float(np.abs(part.force).max()) ** _HERTZ for part in (first, last, load))
            return self.state.q + ((then - now) / (now - begun) if then > now > begun else ahead) * slope
        predicted = self.state.q + ahead * slope
        # where contact opens and closes there is no curve
        if self._earlier is None or self.system.touches:
            return predicted
        earlier, start = self._earlier
        back = inner(done, first.away(start)) / length
        if not 0.2 < back < 5.0 or not 0.0 < ahead < 2.0:
            return predicted
        bend = (slope - (before.q - earlier.q) / back) / (1 + back)
        return predicted + _BEND * ahead * (1 + ahead) * bend


def _line(start: Load, target: Load) -> Callable[[float], Load]:
    return lambda share: start.between(target, share) if share < 1.0 else target
