"""A fit and a diagnosis as objects with tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fingerfit.diagnosis.diagnose import Diagnosis, Everything, added
from fingerfit.diagnosis.diagnose import diagnose as diagnosis_of
from fingerfit.diagnosis.ranking import summary
from fingerfit.diagnosis.second_pass import followed
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.finished import finished_fit
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.fit.simulate import begin, measured, run_fit
from fingerfit.model.effect import OUTLINE
from fingerfit.report.plots import chosen_figure, figures_of
from fingerfit.settings.config import load_settings
from fingerfit.study import reader
from fingerfit.study.study import AXES

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from fingerfit.study.study import Study

FOLDER = Path("results/notebook")
"""Where simulations are kept, in a folder of its own for each model of a study."""


@dataclass(frozen=True)
class Result:
    """A finished fit.

    Parameters
    ----------
    problem : InverseProblem
        Settings, measurements, meshes.
    last : Round
        The last round of the search.
    everything : Data or sequence of Data
        The measurements with all pictures, fitted or not; of a study with several tests those of each.
    run : int
        Simulations that were not known before.
    """

    problem: InverseProblem
    last: Round
    everything: Everything
    run: int

    @cached_property
    def estimate(self) -> dict[str, Any]:
        """What estimate.json of the workflow holds."""
        return estimate_of(self.problem, self.last)

    @property
    def constants(self) -> pd.DataFrame:
        """Constants and numbers of effects, one in each row: value, unit, errors, ends of the 95 % interval."""
        import pandas as pd

        rows = {
            name: {
                "value": entry["value"],
                "unit": entry["unit"],
                "standard_error": entry["standard_error"],
                "mesh_error": entry["mesh_error"],
                "low95": entry["interval95"][0],
                "high95": entry["interval95"][1],
            }
            for name, entry in self.estimate["parameters"].items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    @property
    def correlation(self) -> pd.DataFrame:
        """Correlations of their errors."""
        import pandas as pd

        found = self.estimate["correlation"]
        return pd.DataFrame(found["matrix"], index=found["names"], columns=found["names"])

    @property
    def steps(self) -> pd.DataFrame:
        """Fitted steps: force (N) and displacement (mm) of the indenter; of the model the one that is free.

        Where forces across the load were measured, these too.

        Of a study with several tests, rows are found by test and step.
        """
        import pandas as pd

        shown, tables = finest(self.problem, self.last), dict[str, Any]()
        for test, asked in zip(self.problem.every, shown.every, strict=True):
            data = test.data
            free, _ = data.response_name(0)
            found = {"step": data.step, "force": data.force, "displacement": data.displacement}
            along, lateral = data.split(test.prediction(asked).response)
            found[f"model_{free}"] = along
            for axis, forces, model in zip(AXES, data.lateral_force.T, lateral.T, strict=False):
                found |= {f"force_{axis}": forces, f"model_force_{axis}": model}
            tables[test.test] = pd.DataFrame(found).set_index("step")
        return pd.concat(tables, names=["test"]) if len(tables) > 1 else next(iter(tables.values()))

    @property
    def search(self) -> pd.DataFrame:
        """Guesses of the search in their order, with their scores; without one where there was no solution."""
        import pandas as pd

        return pd.DataFrame([{**guess["values"], "score": guess["score"]} for guess in self.last.history])

    def figure(self, name: str) -> Figure:
        """A figure: ``force``, ``search``, ``deformed_mesh`` or ``pictures``.

        Raises
        ------
        InputError
            Where the fit has no figure of that name.
        """
        return chosen_figure(figures_of(self.problem, self.last), name)


@dataclass(frozen=True)
class Found:
    """What a diagnosis found.

    Parameters
    ----------
    diagnosis : Diagnosis
    """

    diagnosis: Diagnosis

    @property
    def verdict(self) -> str:
        """``adequate``, ``missing``, ``indistinguishable`` or ``unexplained``."""
        return self.diagnosis.verdict.kind

    @property
    def sentence(self) -> str:
        """The same for a person."""
        return self.diagnosis.verdict.sentence

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that are named, the best first."""
        return self.diagnosis.verdict.effects

    @property
    def candidates(self) -> pd.DataFrame:
        """All candidates, the best first: family, explained share of the misfit beyond the noise, odds (logarithm).

        The share by the first pass is ``explained``, that by the refit ``explained_by_refit``.
        """
        import pandas as pd

        entries = summary(self.diagnosis.score_test, self.diagnosis.ranking)
        rows = [
            {
                "effect": entry["effect"],
                "family": one.candidate.effect.family,
                "explained": entry["share_of_excess"],
                "log_odds": entry["first_pass"]["log_odds"] if entry["first_pass"] else None,
                "refitted": (refit := self.diagnosis.refits.get(entry["effect"])) is not None,
                "explained_by_refit": min(1.0, refit.explained(self.diagnosis.score_test.misfit)) if refit else None,
            }
            for entry, one in zip(entries, self.diagnosis.ranking, strict=True)
        ]
        columns = ["effect", "family", "explained", "log_odds", "refitted", "explained_by_refit"]
        return pd.DataFrame(rows, columns=columns).set_index("effect")


def load_study(folder: Path | str) -> Study:
    """Read a study from its folder, or from its study.yaml.

    Raises
    ------
    FingerfitError
        For a study that is wrong, with one line for each problem.
    """
    return reader.load_study(Path(folder))


def fit(config: Path | str | Mapping[str, Any], folder: Path | str = FOLDER, threads: int = 1) -> Result:
    """Fit a study as a config says.

    Parameters
    ----------
    config : Path, str or mapping
        config.yaml, or what stands in it.
    folder : Path or str
        Where simulations are kept: what is known there is not run again.
    threads : int
        Simulations beside each other.

    Raises
    ------
    FingerfitError
        For a config or a study that is wrong, with one line for each problem.
    """
    settings = load_settings(Path(config) if isinstance(config, str) else config)
    place = Path(folder).resolve() / Path(settings.study).resolve().name / settings.model.full_name
    problem, everything = begin(settings, place)
    return _fitted(problem, everything, threads)


def load_result(folder: Path | str) -> Result:
    """The fit that the command line left in ``results/STUDY/MODEL``; call it where that was called.

    Nothing is simulated again, and a diagnosis keeps its simulations beside those of the fit.

    Raises
    ------
    FingerfitError
        For a fit that is not there, not finished or damaged.
    """
    problem, last = finished_fit(Path(folder))
    return Result(problem, last, measured(problem), 0)


def diagnose(result: Result, threads: int = 1) -> Found:
    """Which effect a fitted model lacks."""
    return Found(diagnosis_of(result.problem, result.last, result.everything, threads))


def add(result: Result, found: Found, name: str, threads: int = 1) -> Result:
    """The fit of the model with an effect that was named: it starts where its refit did and runs nothing again.

    Raises
    ------
    InputError
        For an effect that was not refitted.
    """
    problem, last = result.problem, result.last
    if name == OUTLINE and name in found.effects:  # which has other meshes, and no numbers
        folder = problem.sims.parent / f"{problem.settings.model.full_name}+{name}"
        return _fitted(*followed(problem, last, folder), threads)
    return _fitted(added(problem, last, found.diagnosis, name), result.everything, threads)


def _fitted(problem: InverseProblem, everything: Everything, threads: int) -> Result:
    last, run = run_fit(problem, threads)
    return Result(problem, last, everything, run)
