"""Genuine results files of ABAQUS, damaged: each is told, none is read as displacements."""

import os
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from fil import FIL

from fingerfit.core.errors import InputError, SolverError
from fingerfit.solvers.abaqus_fil import read_fil
from fingerfit.solvers.answer import by_node
from fingerfit.testing.damage import DAMAGES

SHARED = Path(os.environ.get("FINGERFIT_SHARED", ROOT.parent / "shared")) / "abaqus"
WHOLE = ("hex_C3D8", "quad_CPE4", "model_results")


def displacements(path, nodes):
    """Displacements of the last increment, as the adapter reads them."""
    (last,) = read_fil(path).last()
    table = last.nodal.get("U", {})
    values = np.array(list(table.values())).reshape(len(table), len(next(iter(nodes.values()))))
    index = {label: number for number, label in enumerate(sorted(nodes))}
    return by_node(list(table), values, index, set(index.values()), "abaqus: deck.inp: U of step 1")


BYTES = {
    "a line lost": lambda text: "\n".join(text.splitlines()[:5] + text.splitlines()[6:]),
    "a line twice": lambda text: "\n".join(text.splitlines()[:6] + text.splitlines()[5:]),
    "a letter for a digit": lambda text: text.replace("D+00", "X+00", 1),
    "zeros from the middle on": lambda text: text[: len(text) // 2] + "\0" * (len(text) - len(text) // 2),
    "no end of the increment": lambda text: text[: text.rindex("*")],
    "another file": lambda text: "<html><body>404</body></html>",
    "lower half of the records": lambda text: text[text.index("*", len(text) // 2) :],
}
# each of one number, which nothing but the deck's own values could tell: `verify` asks for those
NOT_HERE = {"a displacement of 1e30", "a force of 1e30", "a held node that moves"}
DAMAGED = {
    **{name: lambda text, damage=damage: FIL.join(damage(FIL, FIL.split(text))) for name, damage in DAMAGES.items()},
    **BYTES,
}


@pytest.mark.parametrize("name", sorted(DAMAGED.keys() - NOT_HERE))
@pytest.mark.parametrize("stem", WHOLE)
def test_each_damage_is_told(tmp_path, stem, name):
    source = SHARED / f"{stem}.fil"
    if not source.exists():
        pytest.skip(f"no ABAQUS results in {SHARED}: set FINGERFIT_SHARED")
    nodes = read_fil(source).nodes
    assert np.isfinite(displacements(source, nodes)).all()
    text = source.read_text(encoding="latin-1")
    path = tmp_path / "deck.fil"
    path.write_text(DAMAGED[name](text), encoding="latin-1")
    assert FIL.split(path.read_text(encoding="latin-1")) != FIL.split(text)
    with pytest.raises((InputError, SolverError, ValueError)) as caught:
        displacements(path, nodes)
    # a file without any step unpacks to nothing: the adapter counts steps
    assert not isinstance(caught.value, ValueError) or "unpack" in str(caught.value)
    assert "\n" not in str(caught.value)
