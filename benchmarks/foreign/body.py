"""The body is solved by NGSolve: quadratic elements on a grid, indentation step by step, energies of world.py.

A step that finds no equilibrium is halved, down to 1/64 of the whole indentation; what lies beyond is not computed,
and the solution says how far it came.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import netgen.libngpy
import ngsolve as ng
import numpy as np
from ngsolve.meshes import MakeStructured2DMesh, MakeStructured3DMesh
from scipy.interpolate import RegularGridInterpolator
from shapes import placed
from world import Hold, World

ng.SetNumThreads(1)
SMALLEST = 1 / 64
"""Share of the whole way below which a step is given up."""
GRADING = 0.9
"""The largest elements are cosh(0.9)^2 = 2.05 times as long as the smallest."""
SAMPLES = {2: 121, 3: 25}
"""Points along the height at which displacements are read."""


@dataclass
class Solved:
    """What the body does.

    Parameters
    ----------
    nominal : list of ndarray
        Where each sample would lie in the body of the study, mm; arrays over a grid of samples, one for each axis.
    places : ndarray (axes, ...)
        Where it lies without load, mm.
    before : ndarray (axes, ...)
        Displacements in the first picture, mm.
    moved : ndarray (steps, axes, ...)
        Displacements at each step that was reached, from the unloaded place, mm.
    depth, force : ndarray (steps,)
        Indentation since the first picture in mm, and force beyond that in the first picture, in N.
    start : tuple of float
        Indentation (mm) and force (N) in the first picture.
    asked : int
        Steps that were wanted.
    """

    nominal: list[np.ndarray]
    places: np.ndarray
    before: np.ndarray
    moved: np.ndarray
    depth: np.ndarray
    force: np.ndarray
    start: tuple[float, float]
    asked: int

    @property
    def reached(self) -> int:
        """Steps that have an equilibrium."""
        return len(self.depth)


class NoEquilibriumError(RuntimeError):
    """Not even the first picture has an equilibrium."""


def solve(world: World, rows: int) -> Solved:
    """Solve all steps of a world on a mesh with as many rows of elements.

    Raises
    ------
    NoEquilibriumError
        Where the state of the first picture, or the first step, is not found.
    """
    return _Body(world, rows).run()


class _Body:
    """Mesh, energy and present state."""

    def __init__(self, world: World, rows: int) -> None:
        self.world, self.rows = world, rows
        n = world.dimension
        self.mesh, mu = _mesh(world, rows)
        place = (ng.x, ng.y, ng.z)[:n]
        sides, ends = "xyz"[: n - 1], "xyz"[n - 1]
        fixed = {f"dirichlet{axis}": self._glued() for axis in sides}
        fixed[f"dirichlet{ends}"] = "top" if world.base.upwards else "bottom|top"
        self.space = ng.VectorH1(self.mesh, order=2, **fixed)
        u = self.space.TrialFunction()
        self.thick = world.setting["thickness"] if n == 2 else 1.0
        self.form = ng.BilinearForm(self.space, symmetric=True)
        density = self.thick * world.energy(ng.Grad(u), mu, place)
        self.form += ng.Variation(density.Compile() * ng.dx(bonus_intorder=2))
        for face, hold in (("bottom", world.base), ("top", world.top)):
            self._held(u, face, hold, place)
        for side, gap, stiffness in world.walls:
            out = side * (place[0] + u[0]) - (world.width if side > 0 else 0.0) - gap
            face = "right" if side > 0 else "left"
            self.form += ng.Variation(self.thick * stiffness / 2 * ng.IfPos(out, out * out, 0.0) * ng.ds(face))
        down = -(world.load * world.depth) - sum((part(world.load, *place) for part in world.lower), ng.CF(0.0))
        aside = world.aside(world.load) if world.aside else ng.CF(0.0)
        self.top = ng.CF((aside, *([0.0] * (n - 2)), down))
        self.state, self.target = ng.GridFunction(self.space), ng.GridFunction(self.space)
        self.push = ng.GridFunction(self.space)
        self.push.Set(ng.CF((*([0.0] * (n - 1)), 1.0)), definedon=self.mesh.Boundaries("top"))
        self.free = np.array(list(self.space.FreeDofs()), bool)

    def _glued(self) -> str:
        held = {"bottom": self.world.base, "top": self.world.top}
        return "|".join(face for face, hold in held.items() if not hold.sideways)

    def _held(self, u: Any, face: str, hold: Hold, place: tuple[Any, ...]) -> None:
        n = self.world.dimension
        if hold.sideways:
            u_side = ng.CF(tuple(u[i] for i in range(n - 1))) if n == 3 else u[0]
            self.form += ng.Variation(self.thick * hold.sideways(u_side, place) * ng.ds(face))
        if hold.upwards:
            self.form += ng.Variation(self.thick * hold.upwards(u[n - 1], place) * ng.ds(face))

    def _newton(self) -> bool:
        """Go to the present load; False where no equilibrium is found."""
        form, state = self.form, self.state.vec
        residual, step = state.CreateVector(), state.CreateVector()
        self.target.Set(self.top, definedon=self.mesh.Boundaries("top"))
        step.data = self.target.vec - state
        step.FV().NumPy()[self.free] = 0.0
        form.AssembleLinearization(state)
        residual.data = form.mat * step
        try:
            inverse = form.mat.Inverse(self.space.FreeDofs(), inverse="sparsecholesky")
            state.data += step - inverse * residual
            for _ in range(14):
                form.Apply(state, residual)
                form.AssembleLinearization(state)
                inverse = form.mat.Inverse(self.space.FreeDofs(), inverse="sparsecholesky")
                step.data = inverse * residual
                drop = ng.InnerProduct(step, residual)
                if not np.isfinite(drop):
                    return False
                energy, share = form.Energy(state), 1.0
                state.data -= step
                while not form.Energy(state) <= energy + 1e-9 * abs(energy) and share > 1 / 16:
                    share /= 2
                    state.data += share * step
                if abs(drop) < 1e-12:
                    return bool(drop > -1e-12 and np.isfinite(form.Energy(state)))
        except netgen.libngpy._meshing.NgException:
            return False
        return False

    def _go(self, load: float, now: float) -> bool:
        """From the present load and time to others, in steps as small as it takes."""
        world, kept = self.world, self.state.vec.CreateVector()
        here = (world.load.Get(), world.now.Get())
        done, step = 0.0, 1.0
        smallest = SMALLEST / max(abs(load - here[0]), SMALLEST)
        while done < 1 - 1e-9:
            step = min(step, 1 - done)
            kept.data = self.state.vec
            self._set(here, (load, now), done + step)
            if self._newton():
                done, step = done + step, 2 * step
                continue
            self.state.vec.data = kept
            step /= 2
            if step < min(smallest, 0.25) / 2:
                self._set(here, (load, now), done)
                return False
        return True

    def _set(self, here: tuple[float, float], there: tuple[float, float], share: float) -> None:
        self.world.load.Set(here[0] + share * (there[0] - here[0]))
        self.world.now.Set(here[1] + share * (there[1] - here[1]))

    def _force(self) -> float:
        """On the indenter, positive in compression, N."""
        residual = self.state.vec.CreateVector()
        self.form.Apply(self.state.vec, residual)
        return -ng.InnerProduct(residual, self.push.vec)

    def _release(self) -> None:
        """Move the top until it has no force: the secant method."""
        for share in np.linspace(0.125, 1.0, 8):
            self.world.eased.Set(float(share))
            if not self._newton():
                raise NoEquilibriumError("the first picture has no equilibrium")
        one, other, force = 0.0, 0.02, self._force()
        for _ in range(8):
            if not self._go(other, 0.0):
                raise NoEquilibriumError("the first picture has no equilibrium")
            now = self._force()
            if abs(now) < 1e-6 or now == force:
                return
            one, other, force = other, other - now * (other - one) / (now - force), now

    def run(self) -> Solved:
        """All steps."""
        world = self.world
        world.load.Set(0.0)
        world.now.Set(0.0)
        world.eased.Set(0.0)
        nominal, places = _samples(world, self.rows)
        points = self.mesh(*[axis.ravel() for axis in _inside(places)])

        def read() -> np.ndarray:
            return np.asarray(self.state(points)).T.reshape(places.shape)

        if world.released:
            self._release()
        elif world.start and not self._go(world.start / world.depth, 0.0):
            raise NoEquilibriumError("the first picture has no equilibrium")
        start, before, zero = world.load.Get(), read(), self._force()
        count, times = world.setting["steps"], world.setting["times"]
        moved, force, depth = [], [], []
        for k in range(count):
            if not self._go(start + (k + 1) / count, times[k] / times[-1]):
                break
            moved.append(read())
            force.append(self._force() - zero)
            depth.append(world.depth * (k + 1) / count)
        if not moved:
            raise NoEquilibriumError("the first step has no equilibrium")
        first = (start * world.depth, zero)
        return Solved(nominal, places, before, np.array(moved), np.array(depth), np.array(force), first, count)


def _lines(world: World, rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nominal places of the mesh's lines across and along, and the layer of each row, from below."""
    levels = world.levels() / world.height
    ends = _steady(levels)
    counts = [max(2, round(rows * share)) for share in np.diff(ends)]
    up = [0.0]
    for low, high, count in zip(ends, ends[1:], counts, strict=False):
        up += list(world.height * _graded(np.linspace(low, high, count + 1)[1:]))
    long = max(4, min(round(rows * world.width / world.height), 2 * rows))
    across = world.width * _graded(np.linspace(0.0, 1.0, long + 1))
    return across, np.array(up), np.repeat(np.arange(len(counts)), counts)


def _graded(t: np.ndarray) -> np.ndarray:
    """From 0..1 to 0..1 with smaller steps towards both ends, where the glued corners are."""
    return 0.5 * (1 + np.tanh(GRADING * (2 * t - 1)) / np.tanh(GRADING))


def _steady(s: np.ndarray) -> np.ndarray:
    """The inverse of the grading."""
    return 0.5 * (1 + np.arctanh(np.clip(2 * s - 1, -1, 1) * np.tanh(GRADING)) / GRADING)


def _mesh(world: World, rows: int) -> tuple[Any, Any]:
    """Structured mesh whose lines follow the layers, and mu of each element."""
    across, up, layer = _lines(world, rows)
    long, high = len(across) - 1, len(up) - 1
    if world.dimension == 3:
        breadth = world.setting["breadth"]

        def to_space(x: float, y: float, z: float) -> tuple[float, float, float]:
            return world.width * x, breadth * y, float(up[round(z * high)])

        deep = max(4, round(rows * breadth / world.height))
        mesh = MakeStructured3DMesh(hexes=True, nx=long, ny=deep, nz=high, mapping=to_space)
    else:

        def to_plane(x: float, y: float) -> tuple[float, float]:
            placed = _true(world, across[round(x * long)], up[round(y * high)])
            return float(placed[0]), float(placed[1])

        mesh = MakeStructured2DMesh(quads=True, nx=long, ny=high, mapping=to_plane)
    mu = ng.GridFunction(ng.L2(mesh, order=0))
    moduli = np.array(world.setting["mu"][::-1])
    if world.dimension == 3:
        middle = [np.mean([mesh[v].point[2] for v in el.vertices]) for el in mesh.Elements(ng.VOL)]
        which = np.searchsorted(world.levels()[1:-1], middle)
    else:
        which = np.repeat(layer, long)
    for number, dof in enumerate(mu.space.GetDofNrs(el)[0] for el in mesh.Elements(ng.VOL)):
        mu.vec[dof] = float(moduli[which[number]])
    return mesh, mu


def _true(world: World, x: Any, y: Any) -> tuple[Any, Any]:
    """Where a nominal place of the plane body really is: what is hidden first, then the shape that the study knows."""
    up = world.interfaces(x, y) if world.interfaces else y
    return placed(world.setting, world.outline(x, y) if world.outline else x, up)


def _samples(world: World, rows: int) -> tuple[list[np.ndarray], np.ndarray]:
    """A grid of samples over the nominal body (axes x, y[, z] of the arrays), and where they really are.

    Between the mesh's lines the body of the mesh is bilinear, and so are the samples.
    """
    tall = SAMPLES[world.dimension]
    sides = [world.width, *([world.setting["breadth"]] if world.dimension == 3 else []), world.height]
    axes = [np.linspace(0.0, side, min(int(tall * side / world.height), 3 * tall)) for side in sides]
    nominal = list(np.meshgrid(*axes, indexing="ij"))
    if world.dimension == 3:
        return nominal, np.array(nominal)
    across, up, _ = _lines(world, rows)
    corners = _true(world, *np.meshgrid(across, up, indexing="ij"))
    # the last line may lie below the side by rounding
    inside = np.stack([np.clip(x, line[0], line[-1]) for x, line in zip(nominal, (across, up), strict=True)], axis=-1)
    places = [RegularGridInterpolator((across, up), np.asarray(c))(inside) for c in corners]
    return nominal, np.array(places)


def _inside(places: np.ndarray) -> np.ndarray:
    """The same places a trace inside the body, where rounding cannot put them outside."""
    middle = places.reshape(len(places), -1).mean(axis=1).reshape(-1, *([1] * (places.ndim - 1)))
    return middle + (places - middle) * (1 - 1e-7)
