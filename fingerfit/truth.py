"""Description of a virtual experiment: the body as it really is, what is measured on it, and with which noise."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fingerfit.effects.catalogue import catalogue
from fingerfit.effects.contract import Effect
from fingerfit.errors import FingerfitError, Problems
from fingerfit.keys import Keys, read_yaml
from fingerfit.study import Body, Layer
from fingerfit.truth_check import check_truth

SHAPES = {"capsule": ("from", "to", "radius"), "ellipsoid": ("centre", "radii"), "box": ("low", "high")}
"""Simple shapes that are drawn into volumes, and the numbers that describe them."""


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
    folder : Path
        Of the description.
    file : Path
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
    folder: Path = Path()
    file: Path = Path()

    @property
    def known(self) -> dict[str, Effect]:
        """The catalogue and the experiment's own effects."""
        return catalogue(self.own)

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


def read_truth(path: Path) -> Truth:
    """Read the description of an experiment.

    Raises
    ------
    Problems
        With one line for everything that is wrong.
    """
    problems: list[FingerfitError] = []
    keys = Keys(path, read_yaml(path), "", problems)
    if problems:
        raise Problems(problems)
    keys.known(
        "title", "body", "material", "mesh", "solver", "displacement", "picture", "noise", "seed", "time", "effects",
        "own", "template", "boundary", "study",
    )  # fmt: skip
    body, noise = keys.mapping("body"), keys.mapping("noise")
    noise.known("force", "displacement")
    mesh_file, brick = body.text("mesh", None), body.numbers("brick", 3, None)
    space = mesh_file is not None or "brick" in body.data
    body.known(*(("mesh", "brick", "layers", "tissues", "drawn") if space else ("width", "thickness", "layers")))
    if mesh_file is not None and not (path.parent / mesh_file).exists():
        body.wrong("mesh", mesh_file, "a file that exists")
    layers = _layers(body, "elements" if mesh_file is not None else "height")
    where = ("pixels", "spacing") if space else ("pixels", "side")
    wanted = {
        "material": ("alpha", "poisson"),
        "mesh": () if mesh_file is not None else ("element", "across", "per_layer", "grading"),
        "picture": (*where, "texture", "correlation", "noise", "pictured"),
    }
    tables = {name: _table(keys, name, those, ("origin", "samples") if space else ()) for name, those in wanted.items()}
    displacement = tuple(keys.items("displacement"))
    size = (0.0, 0.0) if space else (body.number("width", above=0.0), body.number("thickness", above=0.0))
    spread = (noise.number("force"), noise.number("displacement"))
    solver, title, seed = keys.text("solver"), keys.text("title"), keys.number("seed")
    own = _own(keys)
    boundary, written = keys.mapping("boundary", {}), keys.mapping("study", {})
    boundary.known("base", "indenter")
    written.known("body", "boundary", "control", "pictures")
    if mesh_file is not None and not isinstance(written.data.get("body"), dict):
        written.wrong("body", "nothing", "the body that the study describes, with a mesh of its own")
    truth = Truth(
        title=title or "",
        layers=layers,
        width=size[0] or 0.0,
        thickness=size[1] or 0.0,
        material=tables["material"],
        mesh=tables["mesh"],
        solver=solver or "",
        displacement=displacement,
        picture=tables["picture"],
        force_noise=spread[0] or 0.0,
        displacement_noise=spread[1] or 0.0,
        seed=int(seed or 0),
        time=tuple(keys.items("time")) if "time" in keys.data else (),
        effects=_effects(keys, own),
        own=own,
        brick=brick if space else None,
        mesh_file=path.parent / mesh_file if mesh_file is not None else None,
        tissues=_tissues(body) if space else {},
        drawn=_drawn(body) if space else (),
        template=keys.text("template", "block.inp.j2") or "",
        boundary=(boundary.data.get("base", "held"), boundary.data.get("indenter", "glued")),
        written=written.data,
        folder=path.parent,
        file=path,
    )
    if not problems:
        check_truth(keys, truth)
    if problems:
        raise Problems(problems)
    return truth


def _own(keys: Keys) -> Path | None:
    """Folder of the experiment's own effects."""
    name = keys.text("own", None)
    if name is not None and not (keys.where.parent / name).is_dir():
        keys.wrong("own", name, "a folder that exists")
        return None
    return None if name is None else keys.where.parent / name


def _layers(body: Keys, place: str) -> tuple[dict[str, Any], ...]:
    found = []
    for number, entry in enumerate(body.items("layers")):
        layer = Keys(body.where, entry, f"body.layers.{number}.", body.problems)
        layer.known("name", place, "mu", "intensity")
        values: dict[str, Any] = {}
        values[place] = layer.number(place, above=0.0) if place == "height" else layer.text(place, None)
        values |= {name: layer.number(name, above=0.0) for name in ("mu", "intensity")}
        found.append({"name": layer.text("name"), **values})
    return tuple(found)


def _table(keys: Keys, name: str, wanted: tuple[str, ...], further: tuple[str, ...]) -> dict[str, Any]:
    if not wanted:
        return {}
    table = keys.mapping(name)
    table.known(*wanted, *(further if name == "picture" else ()))
    for key in wanted:
        if key not in table.data and not table.broken:  # one line is enough
            table.wrong(key, "nothing", "a value")
    return table.data


def _effects(keys: Keys, own: Path | None) -> dict[str, dict[str, float]]:
    effects, known = keys.mapping("effects", {}), catalogue(own)
    effects.known(*known)
    hidden = {}
    for name in effects.data:
        inner = effects.mapping(name)
        if name in known:
            inner.known(*known[name].own({}))
        hidden[name] = {key: inner.number(key) or 0.0 for key in inner.data}
    return hidden


def _tissues(body: Keys) -> dict[str, float]:
    tissues = body.mapping("tissues", {})
    return {str(name).upper(): tissues.number(name) or 0.0 for name in tissues.data}


def _drawn(body: Keys) -> tuple[dict[str, Any], ...]:
    found = []
    for number, entry in enumerate(body.items("drawn") if "drawn" in body.data else []):
        one = Keys(body.where, entry, f"body.drawn.{number}.", body.problems)
        kind = one.choice("shape", tuple(SHAPES))
        if one.data.get("shape") != kind:
            continue
        one.known("shape", "intensity", *SHAPES[kind])
        values: dict[str, Any] = {"shape": kind, "intensity": one.number("intensity")}
        for name in SHAPES[kind]:
            values[name] = one.number(name, above=0.0) if name == "radius" else one.numbers(name, 3)
        if kind == "ellipsoid" and values["radii"] and min(values["radii"]) <= 0:
            one.wrong("radii", list(values["radii"]), "3 numbers above 0")
        found.append(values)
    return tuple(found)
