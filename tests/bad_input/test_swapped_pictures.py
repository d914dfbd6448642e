"""Pictures in the wrong order are a remark, those of held-out steps as well; noise alone is none."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from seeds import generator
from test_damaged_pictures import frame, make, place  # noqa: F401

from fingerfit.cli import main
from fingerfit.imaging.pictures import Picture, write_picture

PUSHED = {"before": 0.0, "step_1": 0.5, "step_2": 1.0, "step_3": 1.5, "step_4": 2.0}
"""How far the bars of each picture have moved, pixels."""


def test_swapped_pictures_are_a_remark(place, capsys):  # noqa: F811
    make(place, ".nii.gz")
    one, two = (place / f"study/step_{n}.nii.gz" for n in (1, 2))
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)
    assert main(["check", "study"]) == 0
    said = capsys.readouterr().out
    assert (
        "remark: step_2.nii.gz (step 2) at 14 N is more like before.nii.gz than step_1.nii.gz (step 1) at 7 N" in said
    )
    assert main(["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]) == 0
    assert "remark: step_2.nii.gz (step 2)" in capsys.readouterr().out


def test_noise_alone_is_no_remark():
    """Pictures of nothing but noise have no order: less than 1 % of studies may be told, here of 400 with 5 pictures each."""
    from fingerfit.imaging.content import FALSE_REMARKS, out_of_order, unlike

    rng = generator(5)
    body = 500 * np.sin(np.indices((20, 20)).sum(axis=0) / 3)
    found = 0
    for _ in range(400):
        before, *pictures = body + rng.normal(0, 20, (6, 20, 20))
        away = [unlike(picture, before) for picture in pictures]
        found += out_of_order(before, away, np.arange(5.0), 20.0, 0.0, pictures.__getitem__) is not None
    # binomial with 1 %: 4 on average, 12 or more with a probability of 0.1 %
    assert found <= 3 * 400 * FALSE_REMARKS


def four_steps(place, fitted):  # noqa: F811
    """A study of four steps, some of them fitted, in whose table any picture can be named at any step."""
    make(place, ".nii.gz")
    for n, (name, push) in enumerate(PUSHED.items()):
        y, x = np.indices((30, 32), dtype=float)
        noise = generator(n).normal(0.0, 20.0, y.shape)
        values = np.rint(2000 + 1500 * np.sin(0.5 * (y + push)) * np.sin(0.4 * x) + noise)
        write_picture(place / f"study/{name}.nii.gz", Picture(values, **frame()), np.uint16)
    config = yaml.safe_load((place / "config.yaml").read_text())
    config["fit"]["steps"] = fitted
    (place / "config.yaml").write_text(yaml.safe_dump(config))


def table(place, pictures):  # noqa: F811
    rows = [f"{n},{0.25 * n},{3.5 * n},{name}.nii.gz" for n, name in enumerate(pictures, 1)]
    (place / "study/steps.csv").write_text("\n".join(["step,displacement,force,picture", *rows, ""]))


@pytest.mark.parametrize("fitted", [[2, 4], [1, 2], [3, 4], [1, 4]], ids=str)
def test_swapped_pictures_of_held_out_steps_are_a_remark(place, capsys, fitted):  # noqa: F811
    """Pictures of steps 1 and 3 are swapped: both, one or none of them may be fitted."""
    four_steps(place, fitted)
    table(place, ["step_1", "step_2", "step_3", "step_4"])
    assert main(["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]) == 0
    assert "remark" not in capsys.readouterr().out
    table(place, ["step_3", "step_2", "step_1", "step_4"])
    assert main(["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]) == 0
    expected = (
        "remark: step_1.nii.gz (step 3) at 10.5 N is more like before.nii.gz than step_3.nii.gz (step 1) at 3.5 N"
    )
    assert expected in capsys.readouterr().out
