"""The body as it really is: what the base model says, and places where a hidden effect changes it.

Energies are written down here by hand, per reference volume in MPa; lengths in mm. Nothing of fingerfit is used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import ngsolve as ng
import numpy as np

Field = Callable[..., Any]
"""Function of the place x, y[, z] in the unloaded body (mm) to a coefficient function."""


@dataclass
class Hold:
    """How a face is held: glued where nothing is said, else by what `energy` says, a potential in MPa mm.

    Parameters
    ----------
    sideways : callable or None
        Potential of the sideways displacement and the place.
    upwards : callable or None
        Potential of the displacement along the indentation and the place; only of the base.
    """

    sideways: Callable[[Any, tuple[Any, ...]], Any] | None = None
    upwards: Callable[[Any, tuple[Any, ...]], Any] | None = None


@dataclass
class Kinematics:
    """Invariants of the elastic part of the deformation; C is the right Cauchy-Green tensor, mu the local modulus."""

    C: Any
    J: Any
    I1: Any
    I2: Any
    mu: Any
    place: tuple[Any, ...]


@dataclass
class World:
    """What is computed; effects.py changes it. `now` goes from 0 to 1 with time, `load` with the
    indentation, `eased` while what was there before the first picture is put in."""

    setting: Mapping[str, Any]
    log_mu: list[Field] = field(default_factory=list)
    energies: list[Callable[[Kinematics], Any]] = field(default_factory=list)
    kept: float = 1.0  # share of the base energy that is left
    loss: float = 0.0  # of the Poisson ratio
    volume: str = "quadratic"
    grown: list[Field] = field(default_factory=list)  # logarithm of growth, alike in all directions
    pulled: list[Field] = field(default_factory=list)  # logarithm of a stretch across before it was glued
    drying: Callable[[Any], Any] | None = None  # logarithm of growth after the first picture, of now
    bulging: Callable[[Any], Any] | None = None  # stretch out of the plane, of load
    ageing: list[Field] = field(default_factory=list)  # logarithm of a factor on mu that comes with time
    base: Hold = field(default_factory=Hold)
    top: Hold = field(default_factory=Hold)
    lower: list[Callable[..., Any]] = field(default_factory=list)  # further lowering of the top: of load, place
    aside: Callable[[Any], Any] | None = None  # sideways motion of the top: of load, mm
    walls: list[tuple[float, float, float]] = field(default_factory=list)  # side, gap, stiffness MPa/mm
    interfaces: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None  # height of a nominal place
    outline: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None  # x of a nominal place
    start: float = 0.0  # indentation before the first picture, mm
    released: bool = False  # the top finds its height without force before the first picture

    def __post_init__(self) -> None:
        self.now, self.load, self.eased = ng.Parameter(0.0), ng.Parameter(0.0), ng.Parameter(0.0)
        self.depth = self.setting["compress"] * self.height
        """Indentation of the last step, mm."""

    @property
    def height(self) -> float:
        """Of the body, mm."""
        return float(sum(self.setting["heights"]))

    @property
    def width(self) -> float:
        """Of the body, mm."""
        return float(self.setting["width"])

    @property
    def dimension(self) -> int:
        """2 (plane strain) or 3."""
        return int(self.setting["dimension"])

    def levels(self) -> np.ndarray:
        """Heights of base, interfaces and top, from below, mm."""
        return np.concatenate([[0.0], np.cumsum(self.setting["heights"][::-1])])

    def within(self, layer: int) -> tuple[float, float]:
        """Lower and upper end of a layer that is counted from the top, mm."""
        levels = self.levels()
        return float(levels[-2 - layer]), float(levels[-1 - layer])

    def layer_at(self, share: float) -> int:
        """A layer from a number between 0 and 1."""
        return min(int(share * len(self.setting["heights"])), len(self.setting["heights"]) - 1)

    def of_layer(self, layer: int) -> Field:
        """1 within a layer, 0 outside."""
        low, high = self.within(layer)

        def inside(*place: Any) -> Any:
            return ng.IfPos(place[-1] - low, ng.IfPos(high - place[-1], 1.0, 0.0), 0.0)

        return inside

    def energy(self, gradient: Any, mu: Any, place: tuple[Any, ...]) -> Any:
        """Energy density; `gradient` is that of the displacement, `mu` what the base model says."""
        n = self.dimension
        poisson = self.setting["poisson"]
        for part in self.log_mu:
            mu = mu * ng.exp(part(*place))
        for part in self.ageing:
            mu = mu * ng.exp(self.now * part(*place))
        F = gradient + ng.Id(n)
        across = upright = out = 1.0
        if self.grown or self.pulled or self.drying:
            growth = self.eased * sum((part(*place) for part in self.grown), ng.CF(0.0))
            growth = growth + (self.drying(self.now) if self.drying else 0.0)
            pull = self.eased * sum((part(*place) for part in self.pulled), ng.CF(0.0))
            across, upright, out = ng.exp(growth - pull), ng.exp(growth + pull / 2), ng.exp(growth + pull / 2)
            parts = (across, upright) if n == 2 else (across, out, upright)
            F = F * ng.CF(tuple(1 / parts[i] if i == j else 0.0 for i in range(n) for j in range(n)), dims=(n, n))
        C = F.trans * F
        beside = (self.bulging(self.load) if self.bulging else 1.0) / out  # stretch out of the plane
        third = beside * beside if n == 2 else None
        J = ng.Det(F) * (beside if n == 2 else 1.0)
        trace = ng.Trace(C)
        squares = ng.Det(C) + trace * third if n == 2 else (trace * trace - ng.InnerProduct(C, C)) / 2
        whole = trace + third if n == 2 else trace
        seen = Kinematics(C, J, J ** (-2 / 3) * whole, J ** (-4 / 3) * squares, mu, place)
        bulk = 2 * mu * (1 + poisson - self.loss) / (3 * (1 - 2 * (poisson - self.loss)))
        density = self.kept * self._ogden(seen, third) + bulk * _volume(self.volume, J)
        for part in self.energies:
            density = density + part(seen)
        return density * (across * upright * out)

    def _ogden(self, seen: Kinematics, third: Any) -> Any:
        """One-term Ogden, as the base model has it: 2 mu / alpha^2 (sum of deviatoric stretches^alpha - 3)."""
        alpha = self.setting["alpha"]
        if self.dimension == 3:
            assert alpha == 2.0, "in space only alpha = 2: it needs no principal stretches"
        if alpha == 2.0:
            return seen.mu / 2 * (seen.I1 - 3)
        return 2 * seen.mu / alpha**2 * (powers(seen, third, alpha) - 3)


def powers(seen: Kinematics, third: Any, alpha: float) -> Any:
    """Sum of the deviatoric principal stretches, each to the power alpha, in the plane.

    Half the difference of the squared stretches is rounded off at 1e-4, so that its derivatives exist at rest.
    """
    C = seen.C
    mean = (C[0, 0] + C[1, 1]) / 2
    half = ng.sqrt((C[0, 0] - C[1, 1]) ** 2 / 4 + C[0, 1] ** 2 + 1e-8)
    own = (mean + half) ** (alpha / 2) + (mean - half) ** (alpha / 2)
    return seen.J ** (-alpha / 3) * (own + third ** (alpha / 2))


def _volume(kind: str, J: Any) -> Any:
    """Volumetric energy for a bulk modulus of 1."""
    if kind == "quadratic":
        return (J - 1) ** 2 / 2
    if kind == "logarithm":
        return ng.log(J) ** 2 / 2
    return (J * J - 1 - 2 * ng.log(J)) / 4
