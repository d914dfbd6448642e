"""A study's own effects can do what ours can: each made again under another name, ours taken away, nothing changes."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
import yaml
from conftest import LAYERS, MU, ROOT, deck_text, phantom
from small_body import SMALL, fitted, written

from fingerfit.anatomy.finger import finger_mesh
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.anatomy.shape import Anatomy
from fingerfit.check.own import own_effects
from fingerfit.core.errors import FingerfitError
from fingerfit.core.folders import OURS
from fingerfit.diagnosis.candidates import candidates, untestable
from fingerfit.diagnosis.comparison import Comparison, anchor_of
from fingerfit.diagnosis.diagnose import diagnose
from fingerfit.diagnosis.ranking import rank_candidates, stiffness_map
from fingerfit.diagnosis.reservations import by_settings
from fingerfit.diagnosis.verdict import decide
from fingerfit.fit.check import check_effects
from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.minimum import finest
from fingerfit.fit.problem import SEARCH, InverseProblem
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.model.catalogue import catalogue
from fingerfit.model.effect import OUTLINE
from fingerfit.model.scales import bound
from fingerfit.settings.config import load_settings
from fingerfit.study.study import Body, Layer, Noise, Step, Study

OURS_BOUND = bound(catalogue(), {"width": 12.0, "height": 12.0, "force": 66.0, "duration": 140.0})
NAMES = sorted(OURS_BOUND.keys() - {OUTLINE})
"""All but one that is known by its name: nothing that a study says makes an effect move the mesh."""
MATERIAL = {"alpha": 1.4, "poisson": 0.49}


def own(name):
    return f"own_{name}"


def remake(folder, names=NAMES):
    """Our effects with all their parts in a study's folder, each under another name."""
    (folder / "effects").mkdir(parents=True)
    for name in names:
        for path in [OURS / f"effects/{name}.yaml", *(OURS / "effects").glob(f"{name}.*j2")]:
            text = re.sub(rf"\beffects\.{name}\b", f"effects.{own(name)}", path.read_text(encoding="utf-8"))
            (folder / "effects" / path.name.replace(name, own(name), 1)).write_text(text, encoding="utf-8")


def only_remade(folder):
    """What is known in a study, without ours, in the order that ours have."""
    known = catalogue(folder)
    return {own(name): known[own(name)] for name in catalogue() if name in NAMES}


@pytest.fixture(scope="module")
def remade(tmp_path_factory):
    folder = tmp_path_factory.mktemp("remade")
    remake(folder)
    return folder


@pytest.fixture(scope="module")
def finger():
    return add_fixtures(finger_mesh(size=4.0, element="C3D4"), (Anatomy().pulp_centre, 0.0))


def decks(folder, mesh, study, values, effects, templates, mu):
    folders = [folder] if folder else []
    return [deck_text(study, mesh, mu | values, MATERIAL, effects, template, folders) for template in templates]


@pytest.mark.parametrize("name", NAMES)
def test_its_decks_are_ours_byte_for_byte(name, remade, finger):
    """In the plane and in space, by force and by displacement, at small and at large sizes."""
    effect = OURS_BOUND[name]
    steps = [(0.3, 0.5), (20.0, 40.0)]
    for control in ("force", "displacement"):
        if "space" in effect.needs and {"block", "layers", "base", "indenter"} & set(effect.needs):
            mesh, mu, templates = (
                brick((12.0, 12.0, 12.0), (2, 2, 3), element="C3D8", layers=LAYERS),
                MU,
                ["block.inp.j2"],
            )
            study = phantom(control, list(steps[control == "force"]))
            body = replace(study.body, width=None, brick=(12.0, 12.0, 12.0))
            timed = tuple(replace(step, time=10.0 * step.number) for step in study.steps)
            study = replace(study, body=body, steps=timed)
        elif "space" in effect.needs or name in ("friction", "bone_mobility"):
            mesh, mu = finger, {"mu_epidermis": 0.138, "mu_subcutaneous": 0.00798}
            templates = ["fingertip.inp.j2", "fingertip_fixed.inp.j2", "fingertip_meshed.inp.j2"]
            body = Body((Layer("epidermis"), Layer("subcutaneous")))
            loads = tuple(Step(n, time=5.0 * n, **{control: load}) for n, load in enumerate(steps[0], 1))
            study = Study(ROOT, "finger", control, loads, None, Noise(), body, "held", "slides")
        else:
            mesh, mu, templates = layered_block(12.0, LAYERS, 4, 2, "CPE8H"), MU, ["block.inp.j2"]
            study = phantom(control, list(steps[control == "force"]))
            # friction needs forces that were measured
            forced = tuple(replace(step, force=step.force or 20.0 * step.number) for step in study.steps)
            sides = {side: "slides" for side in ("base", "indenter") if f"sliding_{side}" in effect.needs}
            timed = tuple(replace(step, time=10.0 * step.number) for step in forced)
            study = replace(study, steps=timed, **sides)
        for size in (0.0, 1.0, 3.0):
            numbers = {p.name: min(p.null + size * p.step, p.upper) for p in effect.parameters}
            there = [one for one in effect.places() if one.get(effect.key("layer"), 0) <= len(study.layer_names)]
            place = {key.split(".")[1]: value for key, value in there[-1].items()}
            ours, theirs = (
                {f"{prefix}.{key}": value for key, value in (numbers | place).items()} for prefix in (name, own(name))
            )
            wanted = decks(None, mesh, study, ours, None, templates, mu)
            assert decks(remade, mesh, study, theirs, only_remade(remade), templates, mu) == wanted
            plain = decks(None, mesh, study, {}, None, templates, mu)
            needless = not effect.under(control).simulated or (effect.control and effect.control != control)
            # a layer that is not there, bones that nobody holds and the like leave a deck as it is, but not all of them
            assert (wanted != plain) == (size > 0) or needless or (size and {"layer", "border"} & place.keys())


@pytest.fixture(scope="module")
def slipping(tmp_path_factory):
    """A small body whose base slips, fitted with a model that holds it."""
    folder = tmp_path_factory.mktemp("slips")
    study = written(folder, effects={"base_slip": {"share": 0.71}})
    remake(study)
    problem, last, _, everything = fitted(study, folder / "model", SMALL)
    return problem, last, everything


def knowing(problem, chosen):
    """The same fit in a world that knows some of the effects only."""
    other = InverseProblem(problem.settings, problem.data, problem.mesh_files, problem.sims)
    other.__dict__["effects"] = {name: problem.effects[name] for name in chosen}
    return other


@pytest.mark.slow
def test_the_diagnosis_treats_them_alike(slipping):
    """Same candidates, untested ones, simulations, falls, map and cure: none of it depends on a name."""
    problem, last, everything = slipping
    worlds = [knowing(problem, NAMES), knowing(problem, map(own, NAMES))]
    found = [candidates(world, finest(world, last).values)[0] for world in worlds]
    asked = [anchor_of(problem, last), *(a for candidate in found[0] for a in candidate.asked)]
    solve_missing(problem, asked, 1)
    assert solve_missing(problem, [a for candidate in found[1] for a in candidate.asked], 1) == 0
    rankings = []
    for world, tested in zip(worlds, found, strict=True):
        comparison = Comparison(world, last, everything)
        rankings.append((comparison, rank_candidates(comparison, comparison.score_test, tested)))
    (ours, first), (theirs, second) = rankings
    assert [own(one.candidate.effect.name) for one in first] == [one.candidate.effect.name for one in second]
    assert [one.finding.fall for one in first] == [one.finding.fall for one in second]
    names = {one.candidate.effect.name for one in first}
    assert {"base_slip", "indenter_slip", "coarse_mesh", "split_layer", "inclusion", "relaxation"} <= names
    assert (stiffness_map(ours, first) == stiffness_map(theirs, second)).all()
    assert len(stiffness_map(theirs, second)) == 30
    titles = [list(untestable(world)) for world in worlds]
    assert titles[0] == titles[1]
    coarse = [
        [replace(one, finding=replace(one.finding, fall=1e9)) for one in ranking if one.candidate.effect.signal]
        for ranking in (first, second)
    ]
    for (comparison, _), ranking in zip(rankings, coarse, strict=True):
        test = comparison.score_test
        verdict = replace(decide(test, ranking, {}, 1), kind="unexplained")
        assert by_settings(verdict, test, ranking, 1).sentence.startswith("the mesh is too coarse: ")


@pytest.mark.slow
def test_the_whole_diagnosis_is_the_same(slipping):
    """With all refits and partners: the same verdict under its own name, and not one simulation more."""
    problem, last, everything = slipping
    few = ("base_slip", "indenter_slip", "tilt")
    wanted = diagnose(knowing(problem, few), last, everything)
    found = diagnose(knowing(problem, map(own, few)), last, everything)
    assert (wanted.verdict.kind, wanted.verdict.effects) == ("missing", ("base_slip",))
    assert wanted.run > found.run == 0
    assert found.verdict == replace(wanted.verdict, effects=tuple(map(own, wanted.verdict.effects)))
    assert {own(name): refit.misfit for name, refit in wanted.refits.items()} == {
        name: refit.misfit for name, refit in found.refits.items()
    }


def test_two_that_replace_the_same_are_not_put_together(slipping):
    problem, last, _ = slipping
    data = problem.settings.model_dump(mode="json")
    data["model"]["effects"] = {"own_base_slip": {"share": 0.24}}
    both = InverseProblem(load_settings(data), problem.data, problem.mesh_files, problem.sims)
    both.__dict__["effects"] = {name: problem.effects[name] for name in ("base_slip", "own_base_slip", "tilt")}
    values = {**finest(problem, last).values, "own_base_slip.share": 0.24}
    assert {c.effect.name for c in candidates(both, values)[0]} == {"tilt"}
    lacking = untestable(both)[both.effects["base_slip"].title]
    assert "a model without own_base_slip" in str(lacking)
    data["model"]["effects"]["base_slip"] = {"share": 0.24}
    with pytest.raises(FingerfitError, match="base_slip, which replaces base of the deck, as own_base_slip does"):
        check_effects(load_settings(data), problem.study, problem.meshes[SEARCH])


def test_a_misspelt_block_is_told(slipping, tmp_path):
    problem, *_ = slipping
    study = tmp_path / "study"
    remake(study, ["base_slip"])
    for name in ("study.yaml", "steps.csv", "pictures"):
        (study / name).symlink_to(problem.study.path.parent / name)
    (study / "effects/own_base_slip.base.inp.j2").rename(study / "effects/own_base_slip.bsae.inp.j2")
    file = study / "effects/own_base_slip.yaml"
    file.write_text(yaml.safe_dump({**yaml.safe_load(file.read_text()), "replaces": ["bsse"]}))
    settings = load_settings({**problem.settings.model_dump(mode="json"), "study": str(study)})
    with pytest.raises(FingerfitError) as caught:
        own_effects(settings, problem.study, problem.meshes[SEARCH])
    first, second = str(caught.value).splitlines()
    assert first.startswith(f"{file}: replaces: found block bsse; expected a block of the deck: base, ")
    assert second.startswith(f"{study}/effects/own_base_slip.bsae.inp.j2: file: found block bsae; expected a block")
