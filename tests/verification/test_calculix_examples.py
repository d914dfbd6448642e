"""CalculiX's own example decks (Debian package calculix-ccx-test) that lie in the subset, solved by both.

Linear quadrilaterals and bricks are integrated fully for this, as CalculiX does; CalculiX iterates to the end and solves
directly. Left out, because there CalculiX's answer is another one for a reason:

- planestress3: CPS4 is a solid plate there, 2 % stiffer where the thickness changes from node to node;
- scheibe: half a turn of a rigid square moves a corner by 3.17 times its side there, and by twice the side here;
- inistrain: one C3D20R on a held face has hourglass modes, so that only its stress (none) is determined;
- contact between meshed bodies, and what else is not in the subset.
"""

import gzip
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fingerfit.deck.reader import read_deck
from fingerfit.solvers.analysis import run_steps

EXAMPLES = Path(os.environ.get("FINGERFIT_CCX_EXAMPLES", "/usr/share/doc/calculix-ccx-test/examples/test"))
DECKS = [
    "achtel2",
    "achtel29",
    "achtel9",
    "achtelcas",
    "achteld",
    "achtelp",
    "ax6",
    "axiplane",
    "beam10p",
    "beam20p",
    "beam8p",
    "beamd",
    "beamidset",
    "beamnh",
    "beamnld",
    "beamnlmpc",
    "beamnlp",
    "beamnlptp",
    "beamp",
    "beamp1rotate",
    "beamp2rotate",
    "beamp2stage",
    "beampdepmpc",
    "beampic",
    "beampis",
    "beamprb",
    "beampset",
    "beamptied1",
    "beamptied2",
    "beamrb",
    "beamrb2",
    "beamwrite",
    "mpcforce",
    "oneel",
    "planestress",
    "planestress2",
    "resstress1",
]
CLOSE = 1e-5
TOLERANCES = {
    "ax6": 1e-4,  # a wedge of 2 degrees
    "axiplane": 1e-3,  # a wedge and a plate
    "beamnh": 2e-4,  # CalculiX stops after a correction of 4e-4 of it, which fall sixfold each iteration
    "beamprb": 1e-4,  # CalculiX's equations of a rigid body, linear in the rotation
}
"""Relative to the largest displacement."""


def source(name):
    """Text of an example, packed or not."""
    for path in (EXAMPLES / f"{name}.inp", EXAMPLES / f"{name}.inp.gz"):
        if path.exists():
            return (
                gzip.decompress(path.read_bytes()).decode()
                if path.suffix == ".gz"
                else path.read_text(encoding="utf-8")
            )
    pytest.skip(f"no {name}.inp in {EXAMPLES}: install calculix-ccx-test or set FINGERFIT_CCX_EXAMPLES")


def solve_with_ccx(text, labels, folder):
    """Displacements at the end of the last step by label, printed by CalculiX with seven digits."""
    lines, at = [], 0
    for line in text.splitlines():
        word = line.upper().replace(" ", "")
        if word.startswith("*STEP") and not at:
            lines += ["*NSET, NSET=EVERY_NODE", *map(str, labels)]
        if word.startswith("*ENDSTEP"):
            lines += ["*NODE PRINT, NSET=EVERY_NODE, FREQUENCY=100000", "U"]
        if word.startswith("*STATIC"):
            lines += ["*CONTROLS, PARAMETERS=FIELD", "1e-8, 1e-8, , , 1e-8, 1e-9"]
            line = re.sub(r", *SOLVER *=[^,]*", "", line, flags=re.IGNORECASE)
        at += word.startswith("*STEP")
        lines.append(line)
    (folder / "deck.inp").write_text("\n".join(lines) + "\n")
    with (folder / "log").open("w") as log:
        subprocess.run(["ccx", "-i", "deck"], cwd=folder, stdout=log, stderr=log, timeout=300, check=False)
    dat = (folder / "deck.dat").read_text(encoding="utf-8")
    blocks = dat.split(" displacements (vx,vy,vz) for set EVERY_NODE and time")[1:]
    assert blocks, (folder / "log").read_text(encoding="utf-8")[-2000:]
    rows = re.findall(r"^ *(\d+) +(\S+) +(\S+) +(\S+)$", blocks[-1].split(" forces")[0].split(" stresses")[0], re.M)
    return {int(label): np.array([float(x), float(y), float(z)]) for label, x, y, z in rows}


@pytest.mark.parametrize("name", DECKS)
def test_example(tmp_path, needs_ccx, name):
    text = source(name)
    path = tmp_path / f"{name}.inp"
    path.write_text(text)
    deck = read_deck(path)
    steps = list(run_steps(deck, path, averaged=False))
    assert steps[-1].arrived and len(steps) == len(deck.steps)
    used = np.unique(np.concatenate([block.nodes.ravel() for block in deck.mesh.blocks]))
    theirs = solve_with_ccx(text, [deck.labels[n][1] for n in used], tmp_path)
    expected = np.array([theirs[deck.labels[n][1]] for n in used])[:, : deck.mesh.dim]
    scale = np.abs(expected).max()
    assert scale > 0
    assert np.abs(steps[-1].displacement[used] - expected).max() < TOLERANCES.get(name, CLOSE) * scale
