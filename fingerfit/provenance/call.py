"""The workflow as a process: its command line, whoever calls it and wherever the package is."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from fingerfit.core.errors import InputError
from fingerfit.core.folders import SHIPPED

PROFILES = SHIPPED / "workflow/profiles"


def command(
    goals: Sequence[str], config: Path, cores: int | None = None, more: Sequence[str] = (), profile: str = "default"
) -> list[str]:
    """Snakemake with our workflow and a profile, to be run without a shell.

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
    profile : str
        Name of a profile that comes with the workflow, or the folder of another one.

    Raises
    ------
    InputError
        When there is no such profile.
    """
    folder = PROFILES / profile if (PROFILES / profile).is_dir() else Path(profile)
    if not (folder / "config.yaml").is_file():
        known = ", ".join(sorted(path.name for path in PROFILES.iterdir()))
        raise InputError("--profile", "name", profile, f"{known}, or a folder with a config.yaml")
    return [
        *(sys.executable, "-P", "-m", "snakemake", *goals, "--snakefile", str(SHIPPED / "Snakefile")),
        *("--workflow-profile", str(folder), "--configfile", str(config)),
        *(("--cores", str(cores)) if cores else ()),
        *more,
    ]
