"""Genuine ABAQUS results: every results file is read, and every deck whose elements are known is solved alike.

Most decks are of one element at small strain. With one CPE3H there is nothing to average at the nodes: that it agrees
says nothing of more of them, where ABAQUS's hybrid is another element.
"""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from solving import solve_deck

from fingerfit.core.errors import InputError
from fingerfit.deck.reader import read_deck
from fingerfit.mesh.elements import ELEMENTS
from fingerfit.solvers.abaqus_fil import read_fil

SHARED = Path(os.environ.get("FINGERFIT_SHARED", ROOT.parent / "shared")) / "abaqus"
RESULTS = sorted(SHARED.glob("*.fil"))
UNKNOWN = {"quad_CPS4I": "CPS4I", "quad_CPS4R": "CPS4R"}
"""Decks whose elements the built-in solver lacks: incompatible modes, and hourglass control."""


def test_the_files_are_there():
    if not RESULTS:
        pytest.skip(f"no ABAQUS results in {SHARED}: set FINGERFIT_SHARED")
    assert len(RESULTS) >= 11


@pytest.mark.parametrize("path", RESULTS, ids=lambda p: p.stem)
def test_every_results_file_is_read(path):
    found = read_fil(path)
    assert len(found.nodes) >= 3
    last = found.last()
    assert [increment.step for increment in last] == [1]
    assert last[0].time == 1.0
    assert set(last[0].nodal["U"]) == set(found.nodes)
    dims = {len(u) for u in last[0].nodal["U"].values()}
    assert dims == ({3} if "C3D8" in path.stem else {2})
    for kind, nodes in found.elements.values():
        assert kind in ELEMENTS or kind in UNKNOWN.values()
        assert set(nodes) <= set(found.nodes)


@pytest.mark.parametrize("path", RESULTS, ids=lambda p: p.stem)
def test_displacements_are_those_of_abaqus(path, tmp_path):
    deck = path.with_name(path.name.replace("_results", "")).with_suffix(".inp")
    if path.stem in UNKNOWN:
        with pytest.raises(InputError, match=UNKNOWN[path.stem]):
            read_deck(deck)
        return
    results = read_fil(path)
    theirs = np.array([results.last()[0].nodal["U"][label] for label in sorted(results.nodes)])
    copy = tmp_path / deck.name
    shutil.copy(deck, copy)
    read, (ours,) = solve_deck(copy)
    # the results file has the nodes' own numbering: compare where they are
    order = [tuple(np.round(results.nodes[label][: read.mesh.dim], 9)) for label in sorted(results.nodes)]
    at = {tuple(np.round(x, 9)): n for n, x in enumerate(read.mesh.points)}
    found = ours.displacement[[at[x] for x in order]]
    assert found == pytest.approx(theirs, abs=1e-5 * np.abs(theirs).max())
    assert np.abs(theirs).max() > 1e-5


def test_broken_results_files(tmp_path):
    path = tmp_path / "x.fil"
    for text, expected in (
        ("no results", "an ASCII .fil"),
        ("*I 15I 211D 1.000000000000000D+00", "items I, D or A"),
        ("*I 13I 211I 11X", "at the start of a record"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=expected):
            read_fil(path)
    with pytest.raises(InputError, match="readable"):
        read_fil(tmp_path / "none.fil")
