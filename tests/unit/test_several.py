"""study.yaml with several tests, and what settings say of them: one line for each mistake."""

import pytest
import yaml
from one_layer import MODEL, TWO_TESTS

from fingerfit.core.errors import InputError, Problems
from fingerfit.core.files import keep_json
from fingerfit.fit.check import check_against_study
from fingerfit.fit.joint import problem_of
from fingerfit.provenance.stages import warm
from fingerfit.settings.config import load_settings
from fingerfit.study.data import Data
from fingerfit.study.reader import load_study

SETTINGS = {
    "model": MODEL,
    "fit": {"score": "likelihood", "stages": [{"name": "s", "kind": "equal"}]},
}


def written(folder, **own):
    data = {key: value for key, value in {**TWO_TESTS, **own}.items() if value is not None}
    (folder / "study.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
    (folder / "steps.csv").write_text("step,displacement,force\n1,0.5,3\n2,1,7\n")
    return folder


def settings(folder, **own):
    return load_settings({**SETTINGS, "study": str(folder), "model": {**SETTINGS["model"], **own}})


def test_a_key_of_a_test_takes_the_place_of_the_one_at_the_top(tmp_path):
    study = load_study(written(tmp_path, title="two"))
    assert [(test.test, test.indenter, test.title) for test in study.tests] == [
        ("plate", "glued", "two"),
        ("greased", "slides", "two"),
    ]
    assert study.every == study.tests and study.of_test("greased").base == "slides"


def test_one_test_is_as_before(tmp_path):
    study = load_study(written(tmp_path, tests=None))
    assert (study.test, study.tests, study.every) == ("", (), (study,))


@pytest.mark.parametrize(
    ("own", "line"),
    [
        ({"tests": None}, None),
        ({"tests": {"plate": {}}}, "tests: found 1 of them; expected two or more, each with a name"),
        ({"tests": [1, 2]}, "tests: found [1, 2]; expected two or more, each with a name"),
        ({"tests": {"plate": {}, "a b": {}}}, "tests.a b: found this name; expected a name of letters"),
        ({"tests": {"plate": {}, "Plate": {}}}, "tests.Plate: found the name of another test but for capitals"),
        (
            {"tests": {"plate": {}, "ball": 3}},
            "tests.ball: found 3; expected keys and values in which the test differs",
        ),
        ({"tests": {"plate": {}, "ball": {"tests": {}}}}, "tests.ball.tests: found tests within a test"),
        ({"tests": {"plate": {}, "ball": {"bodyy": 1}}}, "tests.ball.bodyy: found an unknown key; expected body"),
        ({"tests": {"plate": {}, "ball": {"steps": "none.csv"}}}, "none.csv: steps: found No such file or directory"),
        ({"control": "pull"}, "study.yaml: control: found pull; expected one of force, displacement"),
        ({"boundary": None, "tests": {"a": {}, "b": TWO_TESTS["boundary"]}}, "tests.a.boundary: found nothing"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, own, line):
    written(tmp_path, **own)
    if line is None:
        load_study(tmp_path)
        return
    with pytest.raises(Problems) as told:
        load_study(tmp_path)
    lines = str(told.value).splitlines()
    assert any(line in one for one in lines), lines
    if "control" in own:
        assert len(lines) == 1  # of a shared key once


@pytest.mark.parametrize(
    ("model", "fit", "line"),
    [
        ({}, {"score": "nmi"}, "fit.score: found nmi; expected likelihood: tests are weighed against each other"),
        (
            {"per_test": ["mu_top"]},
            {},
            "model.per_test.0: found mu_top; expected one of model.parameters or effects: mu",
        ),
        ({"material": {"alpha": 1.4}}, {}, "model.material.poisson: found nothing; expected a value of poisson"),
    ],
)
def test_settings_that_do_not_fit_are_one_line(tmp_path, model, fit, line):
    study = written(tmp_path)
    data = {**SETTINGS, "study": str(study), "model": {**SETTINGS["model"], **model}}
    data["fit"] = {**SETTINGS["fit"], **fit}
    with pytest.raises(Problems) as told:
        check_against_study(load_settings(data), load_study(study))
    assert sum(line in one for one in str(told.value).splitlines()) == 1, str(told.value)


def test_a_study_of_one_test_has_nothing_per_test(tmp_path):
    study = written(tmp_path, tests=None)
    with pytest.raises(Problems, match=r"model.per_test: found mu; expected no such key: the study has one test"):
        check_against_study(settings(study, per_test=["mu"]), load_study(study))


def test_each_test_has_its_own_numbers_where_that_is_said(tmp_path):
    study = written(tmp_path)
    own = settings(study, per_test=["mu", "force_gain"], effects={"force_gain": {"gain@plate": 0.05}})
    assert own.starts() == {
        "mu@plate": 0.04,
        "mu@greased": 0.04,
        "force_gain.gain@plate": 0.05,
        "force_gain.gain@greased": 0.0,
    }
    shared = settings(study, effects={"force_gain": {"gain": 0.05}})
    assert list(shared.starts()) == ["mu", "force_gain.gain"]
    assert own.plan().stages[0].tied == ("mu@plate", "mu@greased")


@pytest.mark.parametrize("estimated", [False, True], ids=["no estimate below", "an estimate below"])
def test_a_fit_starts_where_the_numbers_of_each_test_say(tmp_path, monkeypatch, estimated):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two").mkdir()
    values = {"mu": 0.03, "compressibility.loss": 0.01} if estimated else {"mu": 0.04, "compressibility.loss": 0.02}
    if estimated:
        entries = {name: {"value": value} for name, value in values.items()}
        keep_json(tmp_path / "results/two/base+compressibility/estimate.json", {"parameters": entries})
    numbers = {"contrast@plate": 0.5, "contrast@greased": -0.2, "across@plate": 0.25, "along": 0.3}
    effects = {"compressibility": {"loss": 0.02}, "inclusion": numbers}
    found = warm(settings(written(tmp_path / "two"), per_test=["inclusion"], effects=effects)).starts()
    assert found == values | {
        "inclusion.contrast@plate": 0.5,
        "inclusion.contrast@greased": -0.2,
        "inclusion.across@plate": 0.25,
        "inclusion.across@greased": 0.15,
        "inclusion.along@plate": 0.3,
        "inclusion.along@greased": 0.3,
    }


def test_a_number_that_one_test_lacks_is_no_start(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = settings(written(tmp_path), per_test=["force_gain"], effects={"force_gain": {"gain@plate": 0.05}})
    with pytest.raises(
        InputError, match=r"found force_gain, but no .*base/estimate.json; expected an estimate without"
    ):
        warm(own)


def test_numbers_of_tests_that_are_not_there_are_unknown(tmp_path):
    with pytest.raises(Exception, match=r"model.effects.force_gain.gain@ball: found an unknown key"):
        settings(written(tmp_path), per_test=["force_gain"], effects={"force_gain": {"gain@ball": 0.05}})


def test_a_test_may_have_its_own_template(tmp_path):
    from fingerfit.forward.decks import make_deck
    from fingerfit.prepare.prepare import make_mesh

    tests = {"plain": {}, "marked": {"template": "marked.inp.j2"}}
    study = load_study(written(tmp_path, tests=tests))
    own = settings(tmp_path)
    field = r"study.yaml: tests.marked.template: found marked.inp.j2; expected a template beside it or in templates/"
    with pytest.raises(Problems, match=field) as found:
        check_against_study(own, study)
    assert len(found.value.problems) == 1
    (tmp_path / "marked.inp.j2").write_text('{% include "block.inp.j2" %}\n** {{ title }} of its own\n')
    check_against_study(own, study)
    mesh = make_mesh(study, own.model.mesh)
    plain, marked = (make_deck(own, test, mesh, "mesh", own.starts(), own.known_effects()) for test in study.tests)
    assert marked == f"{plain}** {study.title} of its own\n"
    # of all tests: one line
    with pytest.raises(Problems, match=r"study.yaml: template: found none.inp.j2") as found:
        check_against_study(own, load_study(written(tmp_path, template="none.inp.j2")))
    assert len(found.value.problems) == 1


def test_a_guess_is_one_simulation_of_each_test(tmp_path):
    """A number of one test does not change the deck of the other; equal tests share their simulation."""
    from fingerfit.core.files import write_text
    from fingerfit.deck.mesh_file import format_mesh
    from fingerfit.prepare.prepare import make_mesh, prepare

    study = load_study(written(tmp_path))
    own = settings(tmp_path, per_test=["mu"])
    mesh = make_mesh(study, own.model.mesh)
    write_text(tmp_path / "mesh.inp", format_mesh(mesh))
    data: list[Data] = [prepare(test, mesh, None, 1.0, 0.3) for test in study.tests]
    problem = problem_of(own, data, [{"search": tmp_path / "mesh.inp"}] * 2, tmp_path / "sims")
    asked = problem.ask({"mu@plate": 0.04, "mu@greased": 0.05})
    other = problem.ask({"mu@plate": 0.04, "mu@greased": 0.06})
    assert asked.every[0].sim == other.every[0].sim and asked.every[1].sim != other.every[1].sim
    assert asked.sim != other.sim
    assert type(asked).of(asked.plain()) == asked
    assert "tests" not in asked.every[0].plain()
