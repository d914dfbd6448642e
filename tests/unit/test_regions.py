"""Regions of a study: elements that lie in them, constants of their own, and the effect that each of them is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fingerfit.deck.context import deck_context
from fingerfit.imaging.pictures import Picture, write_picture
from fingerfit.mesh.blocks import layered_block
from fingerfit.model.regions import region_effects
from fingerfit.prepare import regions
from fingerfit.prepare.regions import region_lines, with_regions
from fingerfit.study.study import Body, Layer, Noise, Region, Step, Study

LAYERS = (("top", 6.0), ("bottom", 6.0))
MESH = layered_block(12.0, LAYERS, 12, 6, "CPE4")
ACROSS = Region("scar", ((2.0, 4.0), (5.0, 4.0), (5.0, 9.0), (2.0, 9.0)))
"""On sides of elements, in both layers."""
MATERIAL = {"alpha": 1.4, "poisson": 0.45, "mu_top": 0.02, "mu_bottom": 0.06}


def study(*regions, before=None):
    body = Body(tuple(Layer(*layer) for layer in LAYERS), width=12.0, thickness=70.0, regions=regions)
    step = Step(1, force=7.0, displacement=0.5)
    return Study(Path("study.yaml"), "t", "force", (step,), before, Noise(), body, "held", "glued")


def layers(values=(), material=MATERIAL, effects=None, regions=(ACROSS,)):
    """Pieces of the body in a deck, by what they hold of the region."""
    of = study(*regions)
    mesh = with_regions(of, MESH)
    found = deck_context(of, mesh, "m.inp", dict(values), material, effects)["layers"]
    scar = mesh.element_sets["SCAR"] + 1
    return {(one["name"].partition("_")[0], bool(np.isin(one["elements"], scar).any())): one for one in found}


def test_elements_of_a_region_are_those_with_half_of_their_area_in_it():
    mesh = with_regions(study(ACROSS), MESH)
    centre = MESH.points[MESH.blocks[0].nodes].mean(axis=1)
    held = (centre > [2, 4]).all(axis=1) & (centre < [5, 9]).all(axis=1)
    assert mesh.element_sets["SCAR"].tolist() == np.flatnonzero(held).tolist()
    assert region_lines(study(ACROSS), [mesh]) == ["region scar: 15 elements of 15 mm^2; its outline has 15 mm^2"]
    parts = mesh.parts
    assert sum(map(len, parts.values())) == MESH.element_count
    assert {name: len(members) for name, members in parts.items()} == {"TOP": 72 - 9, "BOTTOM": 72 - 6, "SCAR": 15}


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_labels_are_found_at_their_place_whichever_way_the_picture_lies(turn, tmp_path):
    direction = np.diag([turn, 1.0])
    place = Picture(np.zeros((60, 60)), np.full(2, 0.25), np.array([-1.0 if turn > 0 else 13.75, -1.0]), direction)
    index = np.stack(np.meshgrid(np.arange(60), np.arange(60)), axis=-1).reshape(-1, 2)
    x, y = place.to_points(index).T
    held = ((x > 2) & (x < 5) & (y > 4) & (y < 9)).reshape(60, 60)
    write_picture(tmp_path / "labels.mha", replace(place, values=np.where(held, 3, 0)))
    painted = with_regions(study(Region("scar", labels=tmp_path / "labels.mha", label=3)), MESH)
    assert painted.element_sets["SCAR"].tolist() == with_regions(study(ACROSS), MESH).element_sets["SCAR"].tolist()


def test_a_picture_of_several_regions_is_read_once_for_a_mesh(tmp_path, monkeypatch):
    values = np.zeros((60, 60))
    values[10:30, 10:30], values[40:50, 10:30] = 1, 2
    for name in ("labels.mha", "before.mha"):
        write_picture(tmp_path / name, Picture(values, np.full(2, 0.25), np.full(2, -1.0), np.eye(2)))
    read = []
    for name in ("read_labels", "read_picture"):
        own = getattr(regions, name)
        monkeypatch.setattr(regions, name, lambda path, own=own: read.append(path.name) or own(path))
    parts = [Region(name, labels=tmp_path / "labels.mha", label=n) for n, name in ((1, "scar"), (2, "core"))]
    assert with_regions(study(*parts, before=tmp_path / "before.mha"), MESH).element_sets.keys() >= {"SCAR", "CORE"}
    assert read == ["labels.mha", "before.mha"]


def test_a_region_without_constants_is_as_its_layers():
    of = study(ACROSS)
    with_it = deck_context(of, with_regions(of, MESH), "m.inp", {}, MATERIAL)["layers"]
    assert with_it == deck_context(study(), MESH, "m.inp", {}, MATERIAL)["layers"]


def test_a_region_has_its_constants_in_every_layer_and_those_of_the_layer_else():
    found = layers({"mu_scar": 0.3}, {**MATERIAL, "alpha_scar": 5.0, "poisson_top": 0.4})
    assert len(found) == 4
    for layer, poisson in (("TOP", 0.4), ("BOTTOM", 0.45)):
        scar, rest = found[layer, True], found[layer, False]
        assert (scar["mu"], scar["alpha"], scar["poisson"]) == (0.3, 5.0, poisson)
        assert (rest["mu"], rest["alpha"], rest["poisson"]) == (MATERIAL[f"mu_{layer.lower()}"], 1.4, poisson)
    elements = np.concatenate([one["elements"] for one in found.values()])
    assert sorted(elements) == list(range(1, MESH.element_count + 1))


def test_the_effect_of_a_region_changes_mu_there_and_nowhere_else():
    found = layers({"region_scar.contrast": np.log(3)}, effects=region_effects(["scar"]))
    for layer in ("TOP", "BOTTOM"):
        mu = MATERIAL[f"mu_{layer.lower()}"]
        # levels of a field have four decimals
        assert found[layer, True]["mu"] == pytest.approx(3 * mu, rel=1e-4)
        assert found[layer, False]["mu"] == mu


def test_a_test_whose_body_lacks_the_region_is_as_without_the_effect():
    values = {"region_scar.contrast": 1.0}
    with_it = deck_context(study(), MESH, "m.inp", values, MATERIAL, region_effects(["scar"]))["layers"]
    assert with_it == deck_context(study(), MESH, "m.inp", {}, MATERIAL)["layers"]
