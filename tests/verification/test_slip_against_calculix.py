"""Slip beyond a limit of the shear against CalculiX, with an indenter that goes straight down and one that goes aside, too."""

import re

import numpy as np
import pytest
from conftest import LAYERS, MU, ROOT, phantom

from fingerfit.core.files import write_text
from fingerfit.deck.context import deck_context
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.deck.render import render_deck
from fingerfit.mesh.blocks import layered_block
from fingerfit.solvers.contract import CONVERGED
from fingerfit.solvers.registry import get_solver

LOADS = [0.1, 0.2, 0.3]
CASES = {
    "base": {"base_friction.share": 0.6},
    "indenter": {"indenter_friction.share": 0.6},
    "aside": {"indenter_friction.share": 0.6, "sideways.moved": 0.05, "sideways.power": 0.5},
}


@pytest.mark.parametrize("case", CASES)
def test_agrees(tmp_path, needs_ccx, case):
    mesh = layered_block(12.0, LAYERS, 4, 1, "CPE8")
    write_text(tmp_path / "mesh.inp", format_mesh(mesh))
    study = phantom("displacement", LOADS)
    context = deck_context(study, mesh, "mesh.inp", MU | CASES[case], {"alpha": 1.4, "poisson": 0.49})
    text = render_deck("block.inp.j2", context, [ROOT / "templates"])
    # ccx takes a hundred times as long where elements and nodes have numbers in the millions
    text = re.sub(r"\b([12])00(\d{4}), ", r"\1\2, ", text).replace("6000001", "9001")
    write_text(tmp_path / "deck.inp", text)
    ours, theirs = (get_solver(name).solve(tmp_path / "deck.inp", tmp_path) for name in ("builtin", "calculix"))
    assert ours.status == theirs.status == CONVERGED
    assert np.abs(ours.displacement - theirs.displacement).max() < 5e-6
    assert theirs.reaction == pytest.approx(ours.reaction, rel=1e-5, abs=1e-5)
