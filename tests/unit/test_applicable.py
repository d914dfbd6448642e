"""Effects that make no sense in a study are refused before anything runs, each with one line."""

from dataclasses import replace

import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY
from conftest import LAYERS, phantom

from fingerfit.cli import main
from fingerfit.core.errors import FingerfitError
from fingerfit.diagnosis.ladder import add
from fingerfit.mesh.blocks import layered_block
from fingerfit.model.applicable import IN_WORDS, MEASURED, unmet
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import NEEDS
from fingerfit.model.scales import bound
from fingerfit.provenance import stages
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import load_settings

MESH = layered_block(12.0, LAYERS, 4, 2, "CPE8H")
REFUSED = {
    "friction": "friction, which changes nothing in the deck of this study; expected an effect on what block.inp.j2 has",
    "relaxation": "relaxation, which needs a time at every step;",
    "inclusion_in_space": "inclusion_in_space, which needs pictures or measured points and a body in space;",
    "coarse_mesh": "an effect that is no part of a model; expected a finer model.mesh and model.refined",
    "load_step": "an effect that is no part of a model; expected smaller increments in the template",
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A study without times and pictures, and its settings in mine.yaml."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study").mkdir()
    (tmp_path / "study/study.yaml").write_text(yaml.safe_dump(STUDY))
    (tmp_path / "study/steps.csv").write_text(STEPS)
    configure(tmp_path)
    return tmp_path


def configure(folder, **effects):
    config = {"study": "study", "model": {**MODEL, **({"effects": effects} if effects else {})}, "fit": FIT}
    (folder / "mine.yaml").write_text(yaml.safe_dump(config))
    return folder / "mine.yaml"


def test_every_need_has_words():
    assert set(IN_WORDS) == set(NEEDS)
    assert set(MEASURED) < set(NEEDS)


@pytest.mark.parametrize("name", REFUSED)
def test_add_refuses_it(folder, name):
    config = folder / "mine.yaml"
    before = config.read_text(encoding="utf-8")
    with pytest.raises(FingerfitError) as caught:
        add(config, name)
    assert str(caught.value).startswith(f"{config}: model.effects.{name}: found {REFUSED[name]}")
    assert "\n" not in str(caught.value)
    assert config.read_text(encoding="utf-8") == before


@pytest.mark.parametrize(
    ("width", "control", "lacks"), [(12.0, "displacement", False), (None, "displacement", True), (None, "force", False)]
)
def test_only_a_block_goes_on_by_displacements_from_where_a_force_has_left_it(width, control, lacks):
    given = phantom(control, [1.0])
    given = replace(given, body=replace(given.body, width=width))
    effect = bound(catalogue(), {"force": 20.0})["preload"]
    assert unmet(effect, given, MESH, True) == (["a prescribed force"] if lacks else [])


@pytest.mark.parametrize("name", REFUSED)
def test_settings_that_name_it_are_refused(folder, name):
    config = configure(folder, **{name: {}})
    with pytest.raises(FingerfitError) as caught:
        stages.check_model(load_settings(config), config)
    assert str(caught.value).startswith(f"{config}: model.effects.{name}: found {REFUSED[name]}")


def test_each_refused_effect_is_a_line(folder):
    config = configure(folder, friction={}, skin={"contrast": 0.1}, relaxation={})
    with pytest.raises(FingerfitError) as caught:
        stages.check_model(load_settings(config), config)
    assert len(str(caught.value).splitlines()) == 2


def test_nothing_is_written_by_prepare(folder, capsys):
    configure(folder, relaxation={})
    assert main(["prepare", "mine.yaml", "--out", "prepared.npz", "--mesh", "mesh.inp"]) == 1
    assert "relaxation, which needs a time at every step" in capsys.readouterr().err
    assert not (folder / "prepared.npz").exists()


def test_those_that_make_sense_are_taken(folder):
    for name in ("skin", "base_slip", "second_term"):
        assert f"added {name}" in add(folder / "mine.yaml", name)
    stages.check_model(load_settings(folder / "mine.yaml"))


def test_constants_that_start_alike_hide_no_border(folder):
    """A border between equal layers may lie anywhere; the search starts with equal ones."""
    border = {"title": "border", "acts": "structure", "words": "It lies lower.", "look": "At it.", "confirm": "A cut."}
    down = {"unit": "mm", "absent": 0, "lower": -1, "upper": 1, "step": 0.1}
    border |= {"parameters": {"down": down}, "changes": {"border_down": "where(number == 1, down, 0.0)"}}
    (folder / "study/effects").mkdir()
    (folder / "study/effects/border.yaml").write_text(yaml.safe_dump(border))
    one = {"unit": "MPa", "start": 0.1, "lower": 0.001, "upper": 1.0, "log": True}
    config = {"study": "study", "model": {**MODEL, "parameters": {"mu_top": one, "mu_bottom": one}}, "fit": FIT}
    (folder / "mine.yaml").write_text(yaml.safe_dump(config))
    assert "added border" in add(folder / "mine.yaml", "border")
    stages.check_model(load_settings(folder / "mine.yaml"))


def test_a_side_that_slides_has_nothing_that_gives_way():
    glued, sliding = phantom("force", [20.0]), replace(phantom("force", [20.0]), base="slides", indenter="slides")
    for name, needed in (("base_slip", "a base that is held"), ("indenter_probe", "an indenter that is glued")):
        effect = catalogue()[name]
        assert needed not in unmet(effect, glued, MESH, True)
        assert needed in unmet(effect, sliding, MESH, True)
    for side in ("base", "indenter"):
        for name in (f"{side}_coulomb", f"{side}_sticks", f"{side}_sticks_probe"):
            effect = catalogue()[name]
            assert any("slides" in need for need in unmet(effect, glued, MESH, True))
            assert not any("slides" in need for need in unmet(effect, sliding, MESH, True))


@pytest.mark.parametrize(
    ("effect", "number", "value", "bounds"),
    [("tilt", "slope", 3, "-0.4 to 0.4"), ("skin", "thickness", 9, "0.133333 to 1.66667"), ("fibres", "stiffness", -1, "0 to 30")],
)  # fmt: skip
def test_a_number_out_of_bounds_is_refused(folder, effect, number, value, bounds):
    config = configure(folder, **{effect: {number: value}})
    with pytest.raises(FingerfitError) as caught:
        load_settings(config)
    line = f"{config}: model.effects.{effect}.{number}: found {value}; expected {bounds}, the bounds"
    assert str(caught.value) == line
    low, high = effects_of(folder / "study")[effect].bounds()[number]
    for edge in (low, high):
        load_settings(configure(folder, **{effect: {number: edge}}))
