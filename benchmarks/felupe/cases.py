"""What a study is: the entries of cases.yaml, the body as stated and the body as it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml
from body import Body, layered
from material import Material, bulk_modulus
from solver import Contact, Drain, Problem

Array = np.ndarray


@dataclass
class Case:
    """One entry of cases.yaml."""

    title: str
    alpha: float
    nu: float
    layers: list
    control: str
    base: str
    plate: str
    strain: float
    shares: list[float]
    pixel: float
    texture: list
    noise: list
    reading: float
    width: float = 0.0
    thickness: float = 1.0
    sides: list[float] = field(default_factory=list)
    origin: list[float] = field(default_factory=lambda: [0.0, 0.0])
    shape: list = field(default_factory=list)
    fitted: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    blur: float = 0.0
    whole: bool = True
    seed: int = 0
    parts: int = 5  # sub-pixels along a side of a pixel
    ramps: bool = False  # at borders of layers brightness rises over one sub-pixel: they are not rounded
    effects: dict = field(default_factory=dict)
    hidden: list = field(default_factory=list)

    @property
    def space(self) -> bool:
        """Whether the body is a brick in space."""
        return bool(self.sides)

    @property
    def heights(self) -> list[float]:
        """From the base up."""
        return [float(layer[1]) for layer in self.layers][::-1]

    @property
    def names(self) -> list[str]:
        """From the base up."""
        return [layer[0] for layer in self.layers][::-1]

    @property
    def moduli(self) -> Array:
        """From the base up."""
        return np.array([layer[2] for layer in self.layers])[::-1]

    @property
    def height(self) -> float:
        """Of all layers."""
        return sum(self.heights)

    @property
    def extent(self) -> tuple[float, ...]:
        """Sides without the height."""
        return tuple(map(float, self.sides)) if self.space else (float(self.width),)


def load() -> dict[str, Case]:
    """Read cases.yaml."""
    text = (Path(__file__).parent / "cases.yaml").read_text()
    return {name: Case(**entry) for name, entry in yaml.safe_load(text).items()}


def outline(case: Case) -> Callable[[Array], Array] | None:
    """Map the block to the body as stated."""
    if not case.shape:
        return None
    kind, size = case.shape
    wide, high = case.width, case.height

    def shape(points: Array) -> Array:
        x, y = points.T
        s, t = y / high, x / wide
        if kind == "barrel":
            x = wide / 2 + (x - wide / 2) * (1 + 4 * size * s * (1 - s))
        elif kind == "wedge":
            x = x * (1 - size * s)
        elif kind == "dome":
            x = wide / 2 + (x - wide / 2) * np.sqrt(1 - size * s**2)
        else:  # arch: the borders of layers, top and base stay flat
            y = y + size * np.sin(np.pi * t) * 4 * s * (1 - s)
        return np.stack([x, y], 1)

    return shape


def true_shape(case: Case) -> Callable[[Array], Array] | None:
    """Map the block to the unloaded body as it is."""
    stated = outline(case)
    if "interface" not in case.effects:
        return stated
    rise, level = case.effects["interface"], case.heights[0]

    def shape(points: Array) -> Array:
        x, y = points.T
        share = np.where(y < level, y / level, (case.height - y) / (case.height - level))
        return np.stack([x, y + rise * (x / case.width - 0.5) * share], 1)

    return shape


def contact_of(case: Case, force: float) -> Contact:
    """Contacts as they are; `force` is about the largest one (N), for what yields with it."""
    fx = case.effects
    contact = Contact(case.base, case.plate)
    if "loose" in fx:
        contact.loose = lambda p: p[:, 0] < fx["loose"] * case.width - 1e-9
    if "base_bend" in fx:

        def beam(p: Array) -> Array:
            t = p[:, 0] / case.width
            return 3.2 * (t - 2 * t**3 + t**4)

        # a uniform load moves the bending mode with 0.64 of the force
        contact.base_bend = (beam, 0.64 * force / fx["base_bend"])
    if "crown" in fx:
        gap, centre = fx["crown"]
        half = case.width / 2
        contact.plate = "contact"
        contact.crown = lambda x: (
            gap * ((x - centre * case.width) / half) ** 2,
            2 * gap * (x - centre * case.width) / half**2,
            np.full_like(x, 2 * gap / half**2),
        )
        contact.stiff = 2000 * case.layers[0][2] / case.layers[0][1] * case.thickness * 3
    return contact


def stated_material(case: Case, problem: Problem, moduli: Array) -> Material:
    """Material as stated, with shear moduli from the base up."""
    mu = np.asarray(moduli)[problem.layer_at]
    return problem.material(mu, np.full(mu.shape, case.alpha), bulk_modulus(mu, case.nu))


def true_material(case: Case, problem: Problem) -> tuple[Material, Drain | None]:
    """Material as it is."""
    fx, where, names = case.effects, problem.where, case.names
    law = stated_material(case, problem, case.moduli)
    factor = np.ones(law.mu.shape)
    if "septum" in fx:
        name, across, angle, wide, gain = fx["septum"]
        k = names.index(name)
        low = sum(case.heights[:k]) + case.heights[k] / 2
        turn = np.deg2rad(angle)
        beside = (where[0] - across * case.width) * np.sin(turn) - (where[1] - low) * np.cos(turn)
        factor += (gain - 1) * (problem.layer_at == k) / (1 + np.exp((np.abs(beside) - wide / 2) / (0.1 * wide)))
    if "vessel" in fx:
        one, two, radius, gain = fx["vessel"]
        one, way = np.array(one, float), np.array(two, float) - np.array(one, float)
        way /= np.linalg.norm(way)
        to = where - one[:, None, None]
        far = np.linalg.norm(to - way[:, None, None] * np.einsum("iqc,i->qc", to, way), axis=0)
        factor += (gain - 1) / (1 + np.exp((far - radius) / (0.12 * radius)))
    law.mu, law.bulk = law.mu * factor, law.bulk * factor
    if "exponential" in fx:
        name, b = fx["exponential"]
        law.b = np.where(problem.layer_at == names.index(name), b, 0.0)
    if "shrink" in fx:
        name, share = fx["shrink"]
        law.grown = np.where(problem.layer_at == names.index(name), 1 - share, 1.0)
    drain = None
    if "drain" in fx:
        share, late = fx["drain"]
        side = 1 - np.abs(2 * where[0] / case.width - 1)
        drain = Drain(share, late * (0.1 + 0.9 * np.clip(side, 0, 1) ** 2))
    return law, drain


def true_body(case: Case, fine: float = 1.0, flat: bool = False) -> Body:
    """Mesh of the studies; `flat`: the block before it is brought to its shape."""
    if case.space:
        return layered(case.extent, case.heights, round(11 * fine), [round(5 * fine)] * len(case.layers), ratio=2.5)
    rows = {1: 24, 2: 14, 3: 10, 4: 8}[len(case.layers)]
    ratio = 1.0 if "crown" in case.effects else 4.0
    count = round(34 * fine)
    if "loose" in case.effects:
        count = round(50 * fine)  # the end of the strip is singular, too
        ratio = 1.5
    shape = None if flat else true_shape(case)
    return layered(case.extent, case.heights, count, [round(rows * fine)] * len(case.layers), shape, ratio)


def coarse_body(case: Case, across: int = 14, rows: int = 0, shape: Callable[[Array], Array] | None = None) -> Body:
    """Coarse mesh of the body as stated; `shape` replaces the outline of the case."""
    rows = rows or {1: 10, 2: 6, 3: 5, 4: 4}[len(case.layers)]
    if case.space:
        return layered(case.extent, case.heights, 7, [4] * len(case.layers), ratio=2.0)
    return layered(case.extent, case.heights, across, [rows] * len(case.layers), shape or outline(case), 4.0)
