"""The workflow as a process: its command line, whoever calls it and wherever the package is."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from fingerfit.core.folders import SHIPPED


def command(goals: Sequence[str], config: Path, cores: int | None = None, more: Sequence[str] = ()) -> list[str]:
    """Snakemake with our workflow and the profile that comes with it, to be run without a shell.

    Parameters
    ----------
    goals : sequence of str
        Rules; none for the fit.
    config : Path
        Settings.
    cores : int or None
        None for those of the profile.
    more : sequence of str
        Further options of Snakemake.
    """
    profile = SHIPPED / "workflow/profiles/default"
    return [
        *(sys.executable, "-P", "-m", "snakemake", *goals, "--snakefile", str(SHIPPED / "Snakefile")),
        *("--workflow-profile", str(profile), "--configfile", str(config)),
        *(("--cores", str(cores)) if cores else ()),
        *more,
    ]
