"""What several tests need: decks of a small phantom."""

from __future__ import annotations

import importlib.util
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from seeds import VARIABLE, generator, project_seed

from fingerfit.core.files import write_text
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.fit.course import next_round
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.problem import InverseProblem
from fingerfit.fit.rounds import Round
from fingerfit.forward.bodies import deck_of_body
from fingerfit.mesh.blocks import layered_block
from fingerfit.mesh.mesh import Mesh
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import Effect
from fingerfit.study.study import Body, Layer, Noise, Step, Study

ROOT = Path(__file__).resolve().parent.parent
# What takes longest comes first, so that no process is left alone with it at the end.
FIRST = ("cluster", "workflow", "faults", "verification", "page")
LAYERS = (("top", 4.0), ("middle", 4.0), ("bottom", 4.0))
MU = {"mu_top": 2.11e-2, "mu_middle": 3.57e-2, "mu_bottom": 6.56e-2}


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The order of tests that run in several processes; alone they run in the order of their files."""

    def place(item: pytest.Item) -> int:
        return FIRST.index(item.path.parent.name) if item.path.parent.name in FIRST else len(FIRST)

    if hasattr(config, "workerinput"):
        items.sort(key=place)


def all_rounds(problem: InverseProblem, folder: Path) -> tuple[Round, int]:
    """All rounds of a fit, kept as the workflow keeps them; the last one, and how many simulations were not known."""
    last, run = None, 0
    while last is None or last.stop is None:
        last = next_round(problem, last)
        last.save(folder / f"{last.number}.json")
        run += solve_missing(problem, last.batch, 1)
    return last, run


@pytest.fixture
def needs_ccx() -> None:
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX (ccx) is not installed: .ci/run installs it")


def phantom(control: str, values: list[float], base: str = "held", indenter: str = "glued") -> Study:
    steps = tuple(Step(n, **{control: value}) for n, value in enumerate(values, 1))
    body = Body(tuple(Layer(*layer) for layer in LAYERS), width=12.0, thickness=70.0)
    return Study(Path("study.yaml"), "phantom", control, steps, None, Noise(), body, base, indenter)


def deck_text(
    study: Study,
    mesh: Mesh,
    values: Mapping[str, float],
    material: Mapping[str, float],
    effects: Mapping[str, Effect] | None = None,
    template: str = "block.inp.j2",
    folders: Sequence[Path] = (),
) -> str:
    """The deck of a guess, which includes mesh.inp or has a mesh of its own."""
    known = catalogue() if effects is None else effects

    def deck_of(body: Mesh) -> str:
        context = deck_context(study, body, "mesh.inp", values, material, known)
        return render_deck(template, context, [*folders, ROOT / "templates"])

    return deck_of_body(study, mesh, "mesh.inp", known, values, deck_of)


Writer = Callable[..., tuple[Path, Mesh]]


@pytest.fixture
def write_deck(tmp_path: Path) -> Writer:
    """Write a deck of the phantom and return its path and mesh."""

    def write(
        study: Study,
        mesh: Mesh | None = None,
        values: dict[str, float] = MU,
        alpha: float = 1.4,
        poisson: float = 0.495,
    ) -> tuple[Path, Mesh]:
        mesh = mesh or layered_block(12.0, LAYERS, 6, 2)
        write_text(tmp_path / "mesh.inp", format_mesh(mesh))
        context = deck_context(study, mesh, "mesh.inp", values, {"alpha": alpha, "poisson": poisson})
        write_text(tmp_path / "deck.inp", render_deck("block.inp.j2", context, [ROOT / "templates"]))
        return tmp_path / "deck.inp", mesh

    return write


@pytest.fixture
def rng() -> np.random.Generator:
    return generator(7)


def pytest_configure() -> None:
    # set in many containers: each of the thousand programs that the tests start would compile all of our modules again
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    try:
        project_seed()
    except ValueError as error:
        raise pytest.UsageError(str(error)) from None


def pytest_report_header() -> str:
    return f"seed of the random numbers: {VARIABLE}={project_seed()}"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Where there is no header (`-q`), what failed can still be drawn again."""
    if terminalreporter.verbosity < 0:
        terminalreporter.write_line(pytest_report_header())
    _tell_faults(terminalreporter)


def _tell_faults(terminalreporter: pytest.TerminalReporter) -> None:
    """The table of bad inputs and faults, where they ran."""
    file = ROOT / "tests/faults/table.py"
    spec = importlib.util.spec_from_file_location("faults_table", file)
    if spec is not None and spec.loader is not None:
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        module.summarize(terminalreporter)
