"""`fingerfit check` tries a study's own effects, and names what is misspelt in them."""

import re
from pathlib import Path

import pytest
import yaml
from blocks import FIT, MODEL, STEPS, STUDY
from conftest import ROOT

from fingerfit.check.own import own_effects, refuse_when_absent
from fingerfit.core.errors import FingerfitError
from fingerfit.deck.context import deck_context
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.model.formulas import evaluate, put_in
from fingerfit.model.keys import read_effect
from fingerfit.prepare.prepare import make_mesh
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import load_settings
from fingerfit.study.reader import load_study

OWN = {
    "title": "softer on one side",
    "acts": "structure",
    "words": "w",
    "look": "l",
    "confirm": "c",
    "parameters": {"slope": {"unit": "1", "absent": 0, "lower": -2, "upper": 2, "step": 0.2}},
    "changes": {"field": "slope * (x / width - 0.5)"},
}
CONFIG = {"study": "study", "model": MODEL, "fit": FIT}


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study/effects").mkdir(parents=True)
    (tmp_path / "study/study.yaml").write_text(yaml.safe_dump(STUDY))
    (tmp_path / "study/steps.csv").write_text(STEPS)
    return tmp_path / "study"


def checked(study, part="", name="mine", **changes):
    (study / f"effects/{name}.yaml").write_text(yaml.safe_dump({**OWN, **changes}))
    if part:
        (study / f"effects/{name}.inp.j2").write_text(part)
    settings, read = load_settings(CONFIG), load_study(Path("study"))
    return own_effects(settings, read, make_mesh(read, settings.model.mesh))


def told(study, *arguments, **options):
    with pytest.raises(FingerfitError) as caught:
        checked(study, *arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_what_an_effect_changes_is_told(study):
    assert checked(study) == ["effect mine: softer on one side; changes the deck"]
    assert checked(study, changes={}, observes={"force": "force + slope"}, acts="observation") == [
        "effect mine: softer on one side; changes force"
    ]
    assert checked(study, needs="time") == [
        "effect mine: softer on one side; needs a time at every step: not tested here"
    ]
    assert checked(study, changes={}) == [
        "effect mine: softer on one side; changes nothing in this study: not tested here"
    ]


def test_a_misspelt_name_in_a_formula(study):
    line = told(study, changes={"field": "slope * (xx / width)"})
    assert line.startswith("study/effects/mine.yaml: changes.field: found 'slope * (xx / width)'")
    line = told(study, changes={}, acts="observation", observes={"intensity": "intensity * slop"})
    assert line.startswith("study/effects/mine.yaml: observes.intensity: found 'intensity * slop'")
    assert told(study, chnages={}).startswith(
        "study/effects/mine.yaml: chnages: found an unknown key; expected changes"
    )


def test_a_misspelt_name_in_a_part(study):
    line = told(study, "*MATERIAL, NAME=OWN\n{{ effects.mine.slop }}\n")
    assert line.startswith("study/effects/mine.inp.j2: line 2: found ")
    assert "slop" in line


def test_a_keyword_in_a_part_that_the_solver_does_not_have(study):
    with pytest.raises(
        FingerfitError, match=r"effects/mine\.inp\.j2: in the deck of .*, line \d+, \*SPRNG: found an unk"
    ):
        checked(study, "*SPRNG\n")


@pytest.mark.parametrize(
    ("what", "formula", "says"),
    [
        ("alpha", "0 * slope", "changes.alpha: found 0; expected not 0"),
        ("poisson", "0.5 + slope", "changes.poisson: found 0.7; expected between -1 and 0.5"),
        ("increment", "-slope", "changes.increment: found -0.2; expected above 0 and at most 1"),
    ],
)
def test_a_constant_that_no_material_has(study, what, formula, says):
    with pytest.raises(FingerfitError, match=re.escape(f"effects/mine.yaml: {says}")):
        checked(study, changes={what: formula})


@pytest.mark.parametrize("name", ["exp", "if"])
def test_a_number_that_means_something_else(study, name):
    with pytest.raises(FingerfitError, match=rf"scan\.{name}: found {name}, which means something else in formulas"):
        checked(study, scan={name: [1, 2]})


def test_names_stand_for_parts_of_formulas(study):
    let = {"left": "x / width", "rest": "left - 0.5", "gentle": "slope", "where_x": "at"}
    short = {"field": "gentle * rest", "poisson": "poisson + gentle / 100"}
    whole = {"field": "slope * (x / width - 0.5)", "poisson": "poisson + slope / 100"}
    observes = {"force": "force * (1 + gentle)"}
    path = study / "effects/mine.yaml"
    more = {"let": let, "scan": {"at": [0.5]}, "place": ["where_x * width", "where_x"]}
    path.write_text(yaml.safe_dump({**OWN, "changes": short, "observes": observes, **more}, sort_keys=False))
    effect = read_effect(path)
    values = {"x": 2.0, "width": 3.0, "slope": 0.3, "poisson": 0.4}
    for what, formula in whole.items():
        assert evaluate(effect.changes[what], values) == evaluate(formula, values)
    assert effect.observes == {"force": "force * (1 + (slope))"}
    assert effect.place == ("(at) * width", "(at)")
    assert checked(study, changes=short, let=let) == ["effect mine: softer on one side; changes the deck"]


@pytest.mark.parametrize(
    ("let", "field", "says"),
    [
        # a name stands for a formula, not for a piece of text
        ({"half": "slope) * (x"}, "half", "let: found half: not a formula; expected a formula for each name"),
        ({"half": "x.real"}, "half", "let: found half: x.real is no number, operation or one of exp"),
        ({"slope": "x"}, "slope", "let.slope: found slope; expected a name that no number of the effect has"),
        ({"exp": "x"}, "exp", "let.exp: found exp, which means something else in formulas"),
        # those above are known, those below are not
        ({"one": "two", "two": "slope"}, "one", "changes.field: found '(two)': two has no value"),
        ({"one": "one + slope"}, "one", "changes.field: found '(one + slope)': one has no value"),
        # a few lines that would be a text of many gigabytes
        (
            {"a0": "x", **{f"a{n}": " + ".join([f"a{n - 1}"] * 90) for n in range(1, 9)}},
            "slope * a8",
            "let: found a2: 48777 characters; at most 2000",
        ),
        ({"a0": "x", **{f"a{n}": f"-(-a{n - 1})" for n in range(1, 99)}}, "a9", "operations more than 100 deep"),
    ],
)
def test_names_that_stand_for_no_formula(study, let, field, says):
    text = yaml.safe_dump({**OWN, "let": let, "changes": {"field": field}}, sort_keys=False)
    (study / "effects/mine.yaml").write_text(text)
    settings, read = load_settings(CONFIG), load_study(Path("study"))
    with pytest.raises(FingerfitError) as caught:
        own_effects(settings, read, make_mesh(read, settings.model.mesh))
    assert "\n" not in str(caught.value)
    assert says in str(caught.value)


def test_a_name_is_a_whole_word():
    assert put_in("a + aa - 1.e5 * e5", {"a": "x", "e5": "y"}) == "(x) + aa - 1.e5 * (y)"


def test_a_formula_that_changes_the_deck_where_the_effect_is_absent(study):
    number = {**OWN["parameters"]["slope"], "absent": 0.3}
    line = told(study, parameters={"slope": number})
    assert line == (
        "study/effects/mine.yaml: changes.field: found 'slope * (x / width - 0.5)', which changes the deck at the absent"
        " values slope 0.3; expected a formula that changes nothing there"
    )
    assert (
        "changes the deck"
        in checked(study, parameters={"slope": number}, changes={"field": "(slope - 0.3) * x / width"})[0]
    )


@pytest.mark.parametrize(
    ("what", "wrong", "right"),
    [
        ("force", "force + 1 + slope", "force + slope - 0.3"),
        ("displacement", "displacement * slope", "displacement * (0.7 + slope)"),
        ("intensity", "intensity + slope * x / width", "intensity + (slope - 0.3) * x / width * (k > 0)"),
        ("shift_x", "slope * now", "(slope - 0.3) * now"),
        ("shift_y", "where(k < 1, slope, 0)", "where(k < 1, slope - 0.3, 0)"),
        ("force", "where(k > 1, force * (1 + slope), force)", "force * exp(sin(slope) - sin(0.3))"),
        ("force", "force * (1 + slope * (place - 1))", "force * (1 + (slope - 0.3) * (place - 1))"),
    ],
)
def test_a_formula_that_changes_what_is_measured_where_the_effect_is_absent(study, what, wrong, right):
    number = {"slope": {**OWN["parameters"]["slope"], "absent": 0.3}}
    own = {"parameters": number, "changes": {}, "acts": "observation", "scan": {"place": [1, 2]}}
    assert told(study, **own, observes={what: wrong}) == (
        f"study/effects/mine.yaml: observes.{what}: found {wrong!r}, which changes what is measured at the absent values"
        " slope 0.3; expected a formula that changes nothing there"
    )
    use = f"changes {what}" if what != "displacement" else "changes nothing in this study: not tested here"
    assert checked(study, **own, observes={what: right}) == [f"effect mine: softer on one side; {use}"]


@pytest.mark.parametrize("dim", [2, 3])
def test_effects_of_the_catalogue_change_nothing_that_is_measured_where_they_are_absent(study, dim):
    mesh = brick((3.0, 2.0, 1.0), (2, 2, 1)) if dim == 3 else layered_block(12.0, (("body", 8.0),), 2, 2, "CPE4")
    known = effects_of(Path("study"), whole=True).values()
    tried = [one for one in known if one.observes and ("plane", "space")[3 - dim] not in one.needs]
    for effect in tried:
        refuse_when_absent(load_study(Path("study")), mesh, effect)
    assert {"force_offset", "soft_frame", "intensity_drift"} <= {one.name for one in tried}
    assert ("turned_in_space" if dim == 3 else "turned_pictures") in {one.name for one in tried}


def test_a_file_that_would_be_overlooked(study):
    (study / "effects/other.yml").write_text("title: t\n")
    assert (
        told(study)
        == "study/effects/other.yml: file: found the ending .yml; expected other.yaml: files of effects end in .yaml"
    )


def test_an_effect_in_the_place_of_one_that_comes_with_fingerfit(study):
    assert checked(study, name="tilt")[1:] == [
        "remark: study/effects/tilt.yaml replaces the effect tilt that comes with fingerfit or a package"
    ]


def test_a_part_without_an_effect(study):
    (study / "effects/mien.inp.j2").write_text("** nothing\n")
    line = told(study)
    assert line == "study/effects/mien.inp.j2: file: found no .yaml beside it; expected mien.yaml, or no such part"


def test_the_example_of_the_documentation(study):
    """YAML and part as docs/diagnosis.md gives them."""
    text = (ROOT / "docs/diagnosis.md").read_text(encoding="utf-8")
    effect = text.split("<!-- effects/return_spring.yaml -->\n```yaml\n")[1].split("```")[0]
    part = text.split("<!-- effects/return_spring.inp.j2 -->\n```\n")[1].split("```")[0]
    (study / "effects/return_spring.yaml").write_text(effect)
    (study / "effects/return_spring.inp.j2").write_text(part)
    assert checked(study) == [
        "effect mine: softer on one side; changes the deck",
        "effect return_spring: a spring that draws the indenter back; changes the deck",
    ]
    # it takes up as much of the force as it says, with a solver
    settings = load_settings(CONFIG)
    problem, _ = begin(settings, study.parent / "model")
    asked = [problem.ask({"mu": 0.05, "return_spring.stiffness": stiffness}) for stiffness in (0.0, 5.0)]
    solve_missing(problem, asked, 1)
    without, drawn = (problem.prediction(one).response for one in asked)
    assert drawn - without == pytest.approx([5.0 * 0.4, 5.0 * 0.8], rel=1e-6)


def test_every_name_of_the_documentation_is_there(study):
    """The table of names against what a template may name."""
    text = (ROOT / "docs/diagnosis.md").read_text(encoding="utf-8")
    rows = text.split("| name in a part | what it is |")[1].split("\n\n")[0]
    documented = set(re.findall(r"`(\w+)", "\n".join(row.split("|")[1] for row in rows.splitlines()[2:]))) - {"x"}
    settings, read = load_settings(CONFIG), load_study(Path("study"))
    context = deck_context(read, make_mesh(read, settings.model.mesh), "mesh", {"mu": 0.05}, settings.model.material)
    assert documented == set(context)
