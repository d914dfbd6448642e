"""What a virtual experiment is made of: the body as it really is, what is measured on it, and with which noise."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import Effect
from fingerfit.study.study import Body, Layer

SHAPES = {"capsule": ("from", "to", "radius"), "ellipsoid": ("centre", "radii"), "box": ("low", "high")}
"""Simple shapes that are drawn into volumes, and the numbers that describe them."""
BRIGHTEST = 16.0
"""Largest intensity that is stored, in multiples of that of a pixel full of the brightest tissue."""


@dataclass(frozen=True)
class Truth:
    """What an experiment is made of.

    Parameters
    ----------
    layers : tuple of dict
        ``name, height`` (mm), ``mu`` (MPa), ``intensity`` (0..1), from the indenter down; of a mesh, ``elements`` in
        place of the height.
    width, thickness : float
        Of a block in the plane, mm.
    material : dict
        ``alpha`` and ``poisson``.
    mesh : dict
        ``element, across, per_layer, grading``; empty for a mesh file.
    solver : str
    displacement : tuple of float
        Of the indenter at the steps, mm.
    picture : dict
        ``texture`` (relative spread), ``correlation`` (mm), ``noise`` (0..1), ``pictured``: steps with a picture; in
        the plane ``pixels`` of a side and ``side`` in mm; in space ``pixels`` and ``spacing`` (mm) along x, y, z and,
        where the body is not in the middle, ``origin`` (mm) and ``samples`` in each voxel.
    force_noise : float
        Standard deviation as a share of the largest force.
    displacement_noise : float
        mm.
    seed : int
        Of texture and noise.
    time : tuple of float
        At the end of each step, s; needed by effects that depend on it.
    effects : dict
        Hidden effects and their numbers.
    own : Path, optional
        A folder whose ``effects/`` has effects that are not in the catalogue.
    brick : tuple of float, optional
        Sides of a brick of layers, mm.
    mesh_file : Path, optional
        Mesh of the body.
    tissues : dict
        Intensity of further element sets of it; what has none is dark.
    drawn : tuple of dict
        Shapes with an ``intensity`` that are seen and nothing else: tendons, vessels.
    template : str
        Deck, looked up beside the description, then in templates/.
    boundary : tuple of str
        Base and indenter, as in a study.
    written : dict
        ``body, boundary, control, pictures`` of the study that is written, where they are not those of the truth.
    path : Path
        The description.
    """

    title: str
    layers: tuple[dict[str, Any], ...]
    width: float
    thickness: float
    material: dict[str, float]
    mesh: dict[str, Any]
    solver: str
    displacement: tuple[float, ...]
    picture: dict[str, Any]
    force_noise: float
    displacement_noise: float
    seed: int
    time: tuple[float, ...] = ()
    effects: dict[str, dict[str, float]] = field(default_factory=dict)
    own: Path | None = None
    brick: tuple[float, ...] | None = None
    mesh_file: Path | None = None
    tissues: dict[str, float] = field(default_factory=dict)
    drawn: tuple[dict[str, Any], ...] = ()
    template: str = "block.inp.j2"
    boundary: tuple[str, str] = ("held", "glued")
    written: dict[str, Any] = field(default_factory=dict)
    path: Path = Path("experiment.yaml")

    @property
    def known(self) -> dict[str, Effect]:
        """The catalogue and the experiment's own effects."""
        return catalogue(self.own)

    @property
    def folder(self) -> Path:
        """Of the description."""
        return self.path.parent

    @property
    def values(self) -> dict[str, float]:
        """Constants and the numbers of hidden effects, as a guess names them."""
        own = {f"mu_{layer['name']}": layer["mu"] for layer in self.layers}
        return own | {f"{name}.{key}": v for name, numbers in self.effects.items() for key, v in numbers.items()}

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return 2 if self.brick is None and self.mesh_file is None else 3

    @property
    def body(self) -> Body:
        """The body as a study describes one."""
        layers = tuple(Layer(layer["name"], layer.get("height"), layer.get("elements")) for layer in self.layers)
        if self.mesh_file is not None:
            return Body(layers, mesh=self.mesh_file)
        if self.brick is not None:
            return Body(layers, brick=(self.brick[0], self.brick[1], self.brick[2]))
        return Body(layers, width=self.width, thickness=self.thickness)
