"""Rounds of the search on disk, and the folders of the simulations they ask for.

A round file holds everything that is known up to it (the history of guesses with their scores) and the batch
of guesses that it asks for, with the text of their decks. The folder of a simulation is named by the hash of
its deck, the mesh the deck includes and the identity of the solver, and can always be made again from a round.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from fingerfit.core.errors import StateError
from fingerfit.core.files import MESH, digest, keep_json, read_bytes, read_json, read_record, write_json, write_text
from fingerfit.deck.cards import includes, read_text


def simulation_name(deck: str, solver: Mapping[str, Any]) -> str:
    """Name of a simulation: the deck names its mesh by content, so text and solver identify the answer.

    So do the contents of other files that a template of one's own includes, by their whole path.
    """
    return digest(deck, json.dumps(solver, sort_keys=True), *(text for _, text in included_files(deck)))


def included_files(text: str) -> list[tuple[Path, str]]:
    """Files that the text of a deck includes by their whole path, and what these include, with their texts."""
    found: list[tuple[Path, str]] = []
    for path in map(Path, includes(text)):
        # another path leads nowhere from the folder of a simulation, but to its mesh: the solver's check refuses it
        if path.is_absolute() and path.is_file() and path not in [known for known, _ in found]:
            inner = read_text(path)
            found += [(path, inner), *included_files(inner)]
    return found


def check_deck(deck: Path, solver: Mapping[str, Any]) -> None:
    """Refuse a deck or a mesh of a simulation whose content is not the one that it is named after.

    Parameters
    ----------
    deck : Path
        ``sims/{name}/deck.inp``.
    solver : mapping
        What ``solver.json`` beside it says.

    Raises
    ------
    StateError
        Saying what to remove.
    """
    meshes = [deck.parent.parent.parent / "meshes" / mesh for mesh in solver.get("includes", ())]
    wrong = [mesh for mesh in meshes if mesh.exists() and digest(read_bytes(mesh, "mesh", MESH)) != mesh.stem]
    if not is_named(deck, read_text(deck), solver):
        wrong.append(deck)
    for path in wrong:
        raise StateError(f"{path}: cannot be read: damaged, not what its name says; run snakemake after: rm {path}")


def is_named(deck: Path, text: str, solver: Mapping[str, Any]) -> bool:
    """Whether the folder of a deck is named after its text and the solver; or has a name of another kind."""
    identity = {key: value for key, value in solver.items() if key != "includes"}
    name = deck.absolute().parent.name
    return not _NAME.fullmatch(name) or simulation_name(text, identity) == name


NEARBY = "nearby"
"""Key of ``solver.json`` for the simulation whose solution is begun at; part of the name, as the solver is."""
FIRST_ORDER = "first_order"
"""Key that says that the answer is one to first order beside that solution, where there is such a one."""
_NAME = re.compile(r"[0-9a-f]{20}")


@dataclass(frozen=True)
class Asked:
    """One guess that a round asks for.

    Parameters
    ----------
    values : dict
        Parameter values in their units.
    sim : str
        Name of the simulation.
    mesh : str
        Name of the mesh file that the deck includes: the hash of its content.
    deck : str
        Text of the deck.
    role : str
        ``search``; ``+mu_top``, ``-mu_top``, ``+control``, ``-control``: sensitivities; ``final``: on the finest
        mesh; ``anchor``: on the search mesh, to be compared with that; of a candidate the number that is not absent.
    tests : tuple of Asked
        In a study with several tests, the simulation of each; `sim` then names all of them together.
    nearby : str
        Name of the simulation at whose solution the solver begins; nothing: from rest.
    first_order : bool
        Whether the answer is one to first order beside it.
    """

    values: dict[str, float]
    sim: str
    mesh: str
    deck: str
    role: str = "search"
    tests: tuple[Asked, ...] = ()
    nearby: str = ""
    first_order: bool = False

    @property
    def every(self) -> tuple[Asked, ...]:
        """The simulations of the guess: one for each test."""
        return self.tests or (self,)

    def named(self, solver: Mapping[str, Any]) -> Asked:
        """The same with the name that its deck and what makes the answer give it."""
        return replace(self, sim=simulation_name(self.deck, self.solved_by(solver)))

    def solved_by(self, solver: Mapping[str, Any]) -> dict[str, Any]:
        """What makes the answer beside the deck: the identity of the solver, and the solution that it begins at."""
        begun: dict[str, Any] = {NEARBY: self.nearby} if self.nearby else {}
        return {**solver, **begun, **({FIRST_ORDER: True} if self.first_order else {})}

    def plain(self) -> dict[str, Any]:
        """As JSON has it; without tests where there is one, and without a simulation nearby where there is none."""
        left = {"tests"} | {key for key in (NEARBY, FIRST_ORDER) if not self.__dict__[key]}
        own = {key: value for key, value in self.__dict__.items() if key not in left}
        return own | ({"tests": [one.plain() for one in self.tests]} if self.tests else {})

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> Asked:
        """What `plain` made."""
        return cls(**{**plain, "tests": tuple(cls.of(one) for one in plain.get("tests", ()))})


def simulations(batch: Sequence[Asked]) -> list[Asked]:
    """The simulations of guesses, one of each test."""
    return [one for asked in batch for one in asked.every]


_ASKED = ("batch", "solved")


@dataclass(frozen=True)
class Round:
    """What is known after a round and what it asks for.

    Parameters
    ----------
    number : int
        Counted from 0.
    stage : str
        Stage of the search.
    stop : str or None
        Why the search ended; None while it goes on.
    solver : dict
        Identity of the solver.
    meshes : dict
        Meshes of the model: hash to file name in the model's folder.
    history : list of dict
        Evaluations so far: ``values``, ``sim``, ``score`` (None: diverged), ``message``.
    batch : list of Asked
        Guesses to be simulated before the next round.
    best : dict or None
        The best evaluation so far.
    reason : str or None
        Why the search ended, while the finer mesh is still to be solved.
    slopes : int
        How often slopes were taken so far.
    rough : bool
        Whether the slopes are by one side of each constant only: others follow.
    tolerances : dict
        By the name of the tolerance what the search reached and what is wanted, where there is something to compare.
    solved : list of Asked
        Guesses of iterations that the job of this round made itself (`fingerfit.fit.jobs.next_job`).
    """

    number: int
    stage: str
    stop: str | None
    solver: dict[str, Any]
    meshes: dict[str, str]
    history: list[dict[str, Any]] = field(default_factory=list)
    batch: list[Asked] = field(default_factory=list)
    best: dict[str, Any] | None = None
    reason: str | None = None
    slopes: int = 0
    rough: bool = False
    tolerances: dict[str, list[float]] = field(default_factory=dict)
    solved: list[Asked] = field(default_factory=list)

    @property
    def everything(self) -> list[Asked]:
        """All guesses that were asked for since the round before, solved already or to be simulated."""
        return [*self.solved, *self.batch]

    def save(self, path: Path) -> None:
        """Write as JSON, whole or not at all."""
        data = {**self.__dict__, **{key: [asked.plain() for asked in getattr(self, key)] for key in _ASKED}}
        keep_json(path, data)

    @classmethod
    def load(cls, path: Path) -> Round:
        """Read what `save` wrote.

        Raises
        ------
        StateError
            When the file is missing, damaged or something else.
        """
        data = read_json(path)
        try:
            return cls(**{**data, **{key: [Asked.of(asked) for asked in data.get(key, ())] for key in _ASKED}})
        except (TypeError, KeyError) as error:
            raise StateError(f"{path}: is not a round of a search: {error}") from error


def asked_for(last: Path) -> list[str]:
    """Names of the simulations that the rounds of a fit asked for, as often, up to the one in the file `last`."""
    rounds = [Round.load(last.parent / f"{number}.json") for number in range(Round.load(last).number + 1)]
    found: list[str] = []
    before: list[Asked] = []
    for one in rounds:
        found += [asked.sim for asked in simulations(one.solved)]
        # the last rounds repeat the batch of the one before and add to it
        new = one.batch[len(before) :] if one.batch[: len(before)] == before else one.batch
        found += [asked.sim for asked in simulations(new)]
        before = one.batch
    return found


@lru_cache(maxsize=4096)
def _load_cached(path: str, stamp: int) -> Round:
    return Round.load(Path(path))


def write_folders(
    study: Path, batch: Sequence[Asked], solver: Mapping[str, Any], meshes: Mapping[str, Path]
) -> list[str]:
    """Write what is missing of the folders of simulations: deck, identity of the solver, mesh; returns their names.

    Parameters
    ----------
    study : Path
        Holds the folders ``sims`` and ``meshes``.
    batch : sequence of Asked
    solver : mapping
        Identity of the solver.
    meshes : mapping
        Files of the meshes by the hash of their content.

    Raises
    ------
    StateError
        When such a file has another content.
    """
    for name, file in meshes.items():
        mesh = study / "meshes" / f"{name}.inp"
        if not mesh.exists():
            text = file.read_text(encoding="utf-8")
            if digest(text) != name:
                raise StateError(f"{file}: is not the mesh that the rounds were asked with: remove that file")
            write_text(mesh, text)
    for asked in simulations(batch):
        folder = study / "sims" / asked.sim
        if not (folder / "deck.inp").exists():
            write_text(folder / "deck.inp", asked.deck)
        if not (folder / "solver.json").exists():
            write_json(folder / "solver.json", {**asked.solved_by(solver), "includes": [f"{asked.mesh}.inp"]})
    return list(dict.fromkeys(asked.sim for asked in simulations(batch)))


@dataclass(frozen=True)
class Walk:
    """Walks the rounds of one model for the workflow, and makes the folders of their simulations.

    Parameters
    ----------
    study : Path
        ``results/{study}``, where simulations and meshes are.
    model : Path
        ``results/{study}/{model}``, where the rounds are.
    """

    study: Path
    model: Path

    def _round(self, path: str | Path) -> Round:
        return _load_cached(str(path), Path(path).stat().st_mtime_ns)

    def stopped(self, path: str | Path) -> bool:
        """Whether the search ended with this round."""
        return self._round(path).stop is not None

    def batch(self, path: str | Path, write: bool = True) -> list[str]:
        """Names of a round's simulations; with `write`, their decks where they are missing."""
        current = self._round(path)
        if not write:
            return list(dict.fromkeys(asked.sim for asked in simulations(current.everything)))
        meshes = {name: self.model / file for name, file in current.meshes.items()}
        return write_folders(self.study, current.everything, current.solver, meshes)

    def sim_inputs(self, sim: str) -> list[str]:
        """Files of a simulation: deck, solver, mesh and solution nearby; none where they are not written."""
        folder = self.study / "sims" / sim
        if not (folder / "solver.json").exists():
            return []
        about = read_record(folder / "solver.json", "includes", kept=False)
        files = (["deck.inp"] if FIRST_ORDER in about else []) + ["solution.npz"]
        nearby = [str(self.study / "sims" / about[NEARBY] / file) for file in files] if NEARBY in about else []
        return [
            str(folder / "deck.inp"),
            str(folder / "solver.json"),
            *[str(self.study / "meshes" / name) for name in about["includes"]],
            *nearby,
        ]
