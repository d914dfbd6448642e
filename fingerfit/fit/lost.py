"""Simulations that a solver ended without an answer, while candidates are tried: each is known with its reason.

They are no answers: a program that was killed for its memory may come to its end next time. So nothing of them is kept
beside the solutions; the processes of one diagnosis know them by files of its own, and the next one tries them again.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fingerfit.core.files import write_text
from fingerfit.solvers.contract import DIVERGED, Outcome


class Lost:
    """Names of the simulations that have no answer, and why; all processes that were forked meanwhile know them."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._known: dict[str, str] = {}

    @property
    def noted(self) -> bool:
        """Whether such simulations are noted: else they stop whoever asks for them."""
        return self._folder is not None

    @property
    def names(self) -> set[str]:
        """Names of all."""
        return {path.name for path in self._folder.iterdir()} if self._folder else set(self._known)

    def note(self, sim: str, why: str) -> None:
        """Note that a simulation has no answer."""
        assert self._folder is not None
        write_text(self._folder / sim, why)

    def why(self, sims: str | Iterable[str]) -> str:
        """Why a simulation, or the first of several that has none, has no answer; empty where all have one."""
        for sim in [sims] if isinstance(sims, str) else sims:
            if sim not in self._known and self._folder is not None and (self._folder / sim).exists():
                self._known[sim] = (self._folder / sim).read_text(encoding="utf-8")
            if sim in self._known:
                return self._known[sim]
        return ""

    def answer(self, sim: str, dim: int) -> Outcome | None:
        """What is said of a lost simulation: as of a guess that found no equilibrium in any step; else None."""
        if not (why := self.why(sim)):
            return None
        nothing = np.zeros((0, dim))
        return Outcome(DIVERGED, np.zeros((0, 0, dim)), nothing, nothing, why)

    def note_with(self, other: Lost) -> None:
        """Note, and know, the same as another one."""
        self._folder, self._known = other._folder, other._known

    @classmethod
    @contextmanager
    def noting(cls, every: Sequence[Lost]) -> Iterator[Lost]:
        """Note what is lost in the problems of a fit, whose these are; what was noted stays known to them."""
        with tempfile.TemporaryDirectory(prefix="fingerfit-") as folder:
            for lost in every:
                lost._folder = Path(folder)
            try:
                yield every[0]
            finally:
                for lost in every:
                    for name in lost.names:
                        lost.why(name)
                    lost._folder = None
