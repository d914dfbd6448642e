"""How large a study is, and what its jobs need for it: memory and time that a cluster is asked for."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path

from fingerfit.core.errors import FingerfitError
from fingerfit.imaging.pictures import shape_of
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.config import Settings
from fingerfit.solvers.cost import BUILTIN, SHORT, expected_seconds
from fingerfit.study.reader import load_study

BASE = 600
"""MB of a Python with all libraries that a job loads, and as much again. Measured: 150 to 300."""
WORKFLOW = 300
"""MB of the Snakemakes of a job that fits a whole study: two start it, the third is the study's. Measured: 300."""
PER_NODE = 0.1
"""MB for each node of the mesh that a simulation takes: 0.06 in benchmarks/indentation.md, with room to spare."""
PER_PIXEL = 8e-6
"""MB of a number in double precision."""
MAP = 36
"""Numbers for each pixel beside the pictures: where it comes from, and in which element. Measured: 40 in all with 3."""
WARP = 2.5e-7
"""Seconds for each pixel of each picture of a guess: benchmarks/warp.md."""
KEPT = 1
"""Slopes of the pictures in memory for each number that is fitted; the guesses between which they are taken lie on disk
(`fingerfit.fit.aside`)."""
GUESSES = 150
"""Guesses of a long search: that of the phantom takes 77 simulations in all."""
LONG = float(os.getenv("FINGERFIT_LONG", "60"))
"""Seconds of a simulation from which on it is a job of its own on a cluster (docs/decisions/0024-cluster.md)."""
SPARE = 2
"""How much longer than expected a job may take before a cluster ends it."""
LEAST = 20
"""Minutes of the shortest limit."""


@dataclass(frozen=True)
class Size:
    """What the memory and the time of a study's jobs follow from.

    Parameters
    ----------
    nodes, dim : int
        Of the larger mesh of a model.
    pixels, pictures : int
        Of one picture before it is trimmed, and their number with the one before compression.
    guesses, replicates : int
        The most that a search may ask for; replicates of the measurement.
    numbers, tried : int
        How many numbers are fitted, and the most that a refit of the diagnosis fits.
    solver : str
        Its name.
    """

    nodes: int = 0
    dim: int = 2
    pixels: int = 0
    pictures: int = 0
    guesses: int = 0
    replicates: int = 0
    numbers: int = 0
    tried: int = 0
    solver: str = BUILTIN

    @property
    def simulation(self) -> float:
        """Expected seconds of one simulation."""
        return expected_seconds(self.solver, self.dim, self.nodes)

    @property
    def short(self) -> bool:
        """Whether simulations are worth no jobs of their own, on the larger mesh either."""
        return self.solver == BUILTIN and self.simulation <= SHORT

    @property
    def comparison(self) -> float:
        """Expected seconds for the pictures of one guess."""
        return WARP * self.pixels * self.pictures

    def memory(self, simulations: int, pictures: bool = True, diagnosed: bool = False) -> int:
        """MB of a job that runs as many simulations at once, and compares pictures or does not, or refits effects.

        Each of these processes then holds the pictures of its guess beside those that all share: per pixel the measured
        and the predicted ones, and where each pixel comes from. The slopes of a fit are kept.
        """
        processes, numbers = max(simulations, 1), self.tried if diagnosed else self.numbers
        held = (2 * self.pictures + MAP) * processes + KEPT * numbers * self.pictures
        of_pictures = PER_PIXEL * self.pixels * held if pictures else 0.0
        return round((BASE + PER_NODE * self.nodes) * processes + of_pictures)

    def memory_of_study(self, processors: int, diagnosed: bool = True) -> int:
        """MB of a job that fits a whole study, and diagnoses it, and simulates on so many processors."""
        return WORKFLOW + self.memory(processors, diagnosed=diagnosed)

    def minutes(self, stage: str) -> int:
        """Minutes after which a cluster may end the job of a stage.

        Parameters
        ----------
        stage : str
            A rule: ``simulate``, ``estimate``, ``diagnose_model``; ``study`` for all of them; others read pictures.
        """
        guess = self.simulation + self.comparison
        searched, drawn = min(self.guesses, GUESSES) * guess, self.replicates * self.comparison
        seconds = {
            "simulate": self.simulation,
            "estimate": drawn,
            # its refits take about as many simulations as a search, and its replicates are registered
            "diagnose_model": searched + drawn,
            "study": 2 * (searched + drawn),
        }.get(stage, 10 * self.comparison)
        return LEAST + math.ceil(SPARE * seconds / 60)


def size_of(settings: Settings) -> Size:
    """The size of a model; of what cannot be read nothing: the job that reads it says what is wrong."""
    dim, nodes, pixels, pictures, numbers, more = 2, 0, 0, 0, 0, 0
    try:
        # a job simulates one test at a time, and holds the pictures of all of them
        for test in load_study(Path(settings.study)).every:
            # regions, whose pictures of labels take long to read, have the nodes of their body
            study = replace(test, body=replace(test.body, regions=()))
            pictures += sum(step.picture is not None for step in study.steps) + (study.before is not None)
            meshes = [make_mesh(study, settings.model.mesh)]
            if settings.finer(study):
                meshes.append(make_mesh(study, settings.model.refined, finer=True))
            nodes, dim = max(nodes, *(len(mesh.points) for mesh in meshes)), max(dim, meshes[0].dim)
            pixels = max(pixels, math.prod(shape_of(study.before)) if study.before else 0)
        numbers = len(settings.parameters())
        effects = (effect for name, effect in settings.known_effects().items() if settings.tries(name))
        more = max((len(effect.parameters) + len(effect.refine) for effect in effects), default=0)
    except (FingerfitError, OSError):
        pass
    fit = settings.fit
    return Size(
        nodes, dim, pixels, pictures, fit.max_evaluations, fit.replicates, numbers, numbers + more, settings.solver
    )
