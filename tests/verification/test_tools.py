"""Decks with nodes beside the mesh's and steps beside the measured ones, as those of the fingertip for CalculiX."""

import numpy as np
import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY
from conftest import ROOT, phantom

from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin
from fingerfit.settings.config import load_settings
from fingerfit.solvers.builtin import BuiltinSolver

POINTS = "x,y,ux,uy\n3,2,0,-0.1\n9,6,0,-0.2\n"


def predicted(folder, template):
    """Displacements on the mesh, and prediction, of a model with a template."""
    (folder / "study").mkdir(parents=True)
    block = (ROOT / "templates/block.inp.j2").read_text()
    mesh = "*INCLUDE, INPUT={{ mesh }}\n"
    assert mesh in block
    (folder / "study/tool.inp.j2").write_text(block.replace(mesh, f"{mesh}*NODE\n900001, 0., 50.\n900002, 9., 50.\n"))
    (folder / "study/study.yaml").write_text(yaml.safe_dump(STUDY | {"noise": {**STUDY["noise"], "points": 0.01}}))
    (folder / "study/points.csv").write_text(POINTS)
    first, *rest = STEPS.splitlines()
    (folder / "study/steps.csv").write_text("\n".join([f"{first},points", *(f"{row},points.csv" for row in rest)]))
    config = {"study": str(folder / "study"), "model": {**MODEL, "template": template}, "fit": FIT}
    problem, _ = begin(load_settings(config), folder / "model")
    asked = problem.ask({"mu": 0.05})
    assert ("900001" in asked.deck) == (template == "tool.inp.j2")
    solve_missing(problem, [asked], 1)
    return problem.outcome(asked).displacement, problem.prediction(asked)


def test_nodes_of_tools_are_no_nodes_of_the_body(tmp_path):
    (plain, one), (tool, other) = (predicted(tmp_path / name, f"{name}.inp.j2") for name in ("block", "tool"))
    assert np.abs(one.points).max() > 0.1
    assert np.array_equal(plain, tool)
    assert np.array_equal(one.points, other.points)
    assert np.array_equal(one.response, other.response)


def test_steps_without_prints_are_no_results(tmp_path, write_deck):
    """A first step that only finds the contact: it is neither a measured one nor the state of the first picture."""
    deck, _ = write_deck(phantom("displacement", [0.4, 0.8]))
    whole = BuiltinSolver().solve(deck, tmp_path)
    text = deck.read_text()
    start = text.index("*STEP")
    first = text[start : text.index("*END STEP") + len("*END STEP\n")]
    quiet = first[: first.index("*NODE PRINT")] + "*END STEP\n"
    (tmp_path / "more.inp").write_text(text[:start] + quiet.replace("-0.4", "-0.2") + text[start:])
    found = BuiltinSolver().solve(tmp_path / "more.inp", tmp_path)
    assert found.steps == whole.steps == 2
    assert found.displacement == pytest.approx(whole.displacement, abs=1e-9)
    assert found.reaction == pytest.approx(whole.reaction, rel=1e-6)
