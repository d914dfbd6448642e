"""How long the simulations took that the job of a round solved itself: kept in its log, for whoever watches the run.

The round cannot hold it: rounds of the same fit are the same to the last byte, on all machines.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_LINE = re.compile(r"^simulations solved in this job: (\d+); together ([\d.]+) s$", re.MULTILINE)


@dataclass
class Took:
    """Simulations and the seconds that they took, each by its own clock, whatever ran beside it.

    Parameters
    ----------
    number : int
    seconds : float
        Of all of them.
    """

    number: int = 0
    seconds: float = 0.0

    def add(self, seconds: float, number: int = 1) -> None:
        """Count simulations that took so long together."""
        self.number += number
        self.seconds += seconds

    @property
    def each(self) -> float | None:
        """Mean seconds of a simulation; None where there was none."""
        return self.seconds / self.number if self.number else None

    def told(self) -> str:
        """The line for the log.

        >>> Took(12, 1.5).told()
        'simulations solved in this job: 12; together 1.500 s'
        """
        return f"simulations solved in this job: {self.number}; together {self.seconds:.3f} s"

    @classmethod
    def read(cls, log: Path) -> Took:
        """What the log of a job tells; nothing where it cannot be read or has no such line."""
        try:
            found = _LINE.search(log.read_text(encoding="utf-8", errors="replace"))
        except OSError:
            return cls()
        return cls(int(found[1]), float(found[2])) if found else cls()
