"""Up and down the ladder: config.yaml keeps all its lines but those of the effect."""

import sys
from pathlib import Path

import pytest
from blocks import study_with_pictures
from conftest import ROOT

from fingerfit.cli import main
from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import keep_json, write_text
from fingerfit.diagnosis import climb, ladder
from fingerfit.diagnosis.ladder import add, drop
from fingerfit.model.effect import OUTLINE
from fingerfit.provenance import call, stages
from fingerfit.settings.config import load_settings

CONFIG = """\
# a comment at the top
study: study   # where it is
results: results

model:          # the model of the body
  name: base
  # effects: are added below, it is said
  material: {alpha: 1.4,   poisson: 0.49}
  mesh: {element: CPE8, across: 3, per_layer: 2}
  parameters:
    mu_top:     {unit: MPa, start: 1.0e-1, lower: 0.005, upper: 0.5}   # soft
    mu_bottom:  {unit: MPa, start: 0.1, lower: 0.005, upper: 0.5}

fit:
  score: nmi    # mutual information
  stages:
    - {name: grid, kind: grid, points: 4}

# the end
"""
EFFECTS = """\
  effects:   # found so far
    # the most important one
    tilt: {slope: 0.012345678}   # from a photograph
    inclusion:
      contrast: 0.5
      across: 0.25
"""


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "config.yaml", CONFIG)
    study_with_pictures(tmp_path / "study")
    return Path("config.yaml")


def with_effects(at="  mesh:", effects=EFFECTS):
    before, after = CONFIG.split(at)
    return before + effects + at + after


def effects(config):
    return load_settings(config).model.effects


def test_add_changes_nothing_else(config):
    assert "added tilt (tilt of the indenter)" in add(config, "tilt")
    assert effects(config) == {"tilt": {}}
    new = config.read_text(encoding="utf-8")
    assert new.replace("  effects:\n    tilt: {}\n", "") == CONFIG
    assert len(new.splitlines()) == len(CONFIG.splitlines()) + 2


def test_drop_takes_back_what_add_did(config):
    add(config, "tilt")
    once = config.read_text(encoding="utf-8")
    add(config, "inclusion")
    assert list(effects(config)) == ["tilt", "inclusion"]
    drop(config, "inclusion")
    assert config.read_text(encoding="utf-8") == once
    assert "dropped tilt" in drop(config, "tilt")
    assert config.read_text(encoding="utf-8") == CONFIG


@pytest.mark.parametrize("at", ["  name:", "  mesh:", "\nfit:"])
def test_effects_that_were_written_by_hand_stay(config, at):
    """Their comments, digits and place, too."""
    text = with_effects("fit:", EFFECTS) if at == "\nfit:" else with_effects(at)
    text = text.replace("0.5}\n\n  effects", "0.5}\n  effects")
    config.write_text(text)
    add(config, "onset")
    assert effects(config) == {
        "tilt": {"slope": 0.012345678},
        "inclusion": {"contrast": 0.5, "across": 0.25},
        "onset": {},
    }
    assert config.read_text(encoding="utf-8").replace("    onset: {}\n", "") == text
    drop(config, "onset")
    assert config.read_text(encoding="utf-8") == text
    drop(config, "inclusion")
    assert config.read_text(encoding="utf-8") == text.replace(
        "    inclusion:\n      contrast: 0.5\n      across: 0.25\n", ""
    )


def test_effects_on_one_line(config):
    config.write_text(with_effects(effects="  effects: {tilt: {slope: 0.012345678}}\n"))
    add(config, "onset")
    assert effects(config) == {"tilt": {"slope": 0.012345678}, "onset": {}}
    drop(config, "onset")
    drop(config, "tilt")
    assert config.read_text(encoding="utf-8") == CONFIG


def test_effects_at_the_end_without_a_last_newline(config):
    head, model = CONFIG.split("model:")
    model, rest = model.split("fit:")
    config.write_text(head + "fit:" + rest + "model:" + model.rstrip() + "\n  effects:\n    tilt: {slope: 0.01}")
    add(config, "onset")
    assert effects(config) == {"tilt": {"slope": 0.01}, "onset": {}}


def test_add_starts_at_what_the_diagnosis_found(config, tmp_path):
    ranking = [
        {"effect": "tilt", "place": {}, "size": {"slope": 0.0123456}},
        {"effect": "inclusion", "place": {"across": 0.25, "along": 0.5}, "size": {"contrast": 0.7}},
    ]
    keep_json(tmp_path / "results/study/base/diagnosis.json", {"ranking": ranking})
    assert "starting at slope 0.01235" in add(config, "tilt")
    assert effects(config) == {"tilt": {"slope": 0.01235}}
    # the diagnosis of base says nothing about base+tilt
    drop(config, "tilt")
    add(config, "inclusion")
    assert effects(config) == {"inclusion": {"across": 0.25, "along": 0.5, "contrast": 0.7}}


def test_add_starts_where_the_refit_did(config, tmp_path):
    """Not where it ended: its simulations are known."""
    refit = {"parameters": {"tilt.slope": 0.009}, "start": {"slope": 0.0123456789}, "simulations": 14}
    ranking = [{"effect": "tilt", "place": {}, "size": {"slope": 0.02}, "refit": refit}]
    keep_json(tmp_path / "results/study/base/diagnosis.json", {"ranking": ranking})
    assert add(config, "tilt").endswith("starting at slope 0.01235; 14 simulations of its refit are reused")
    assert effects(config) == {"tilt": {"slope": 0.0123456789}}


def refused(config, action, name):
    before = config.read_text(encoding="utf-8")
    with pytest.raises(FingerfitError) as caught:
        action(config, name)
    assert config.read_text(encoding="utf-8") == before
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_what_cannot_be_added_is_one_line(config):
    assert refused(config, add, "tlit") == (
        "config.yaml: model.effects.tlit: found an unknown key; expected tilt (did you mean that?)"
    )
    add(config, "tilt")
    assert refused(config, add, "tilt") == (
        "config.yaml: model.effects.tilt: found it twice; expected an effect that the model does not have yet"
    )
    assert refused(config, drop, "onset") == (
        "config.yaml: model.effects.onset: found no such effect in the model; expected one that it has: tilt"
    )


def test_a_config_without_a_line_for_the_model(config):
    import yaml

    data = yaml.safe_load(CONFIG)
    config.write_text(
        "{"
        + ", ".join(
            f"{key}: {yaml.safe_dump(value, default_flow_style=True, width=1000).split(chr(10))[0]}"
            for key, value in data.items()
        )
        + "}\n"
    )
    assert "model: found no line `model:` of its own" in refused(config, add, "tilt")


def test_the_command_prints_one_line(config, capsys):
    assert main(["add", "tlit"]) != 0
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "did you mean that?" in message


# --- where a richer model starts


def test_without_effects_nothing_is_warm(config):
    settings = load_settings(config)
    assert stages.warm(settings) is settings


def test_without_the_parents_estimate_it_is_one_line(config):
    add(config, "tilt")
    with pytest.raises(InputError) as caught:
        stages.warm(load_settings(config))
    line = str(caught.value)
    assert line == (
        "config.yaml: model.effects.tilt: found tilt, but no results/study/base/estimate.json;"
        " expected an estimate without it first: fingerfit drop tilt, then the same run"
    )


def test_effects_with_all_their_numbers_need_no_estimate_before(config):
    plain = load_settings(config).starts()
    write_text(
        config, with_effects(effects="  effects:\n    compressibility: {loss: 0.01}\n    base_slip: {share: 0.1}\n")
    )
    found = stages.warm(load_settings(config)).starts()
    assert found == plain | {"compressibility.loss": 0.01, "base_slip.share": 0.1}


def test_the_search_starts_at_the_parents_estimate(config, tmp_path):
    write_text(
        config,
        with_effects(
            effects="  effects:\n    compressibility: {loss: 0.01}\n    inclusion: {contrast: 0.7, along: 0.3}\n"
        ),
    )
    values = {"mu_top": 0.031, "mu_bottom": 0.062, "compressibility.loss": 0.017}
    parameters = {name: {"value": value} for name, value in values.items()}
    keep_json(tmp_path / "results/study/base+compressibility/estimate.json", {"parameters": parameters})
    found = stages.warm(load_settings(config)).starts()
    wanted = values | {"inclusion.contrast": 0.7, "inclusion.along": 0.3, "inclusion.across": 0.15}
    assert found == pytest.approx(wanted)
    assert str(stages.model_folder(load_settings(config))) == "results/study/base+compressibility+inclusion"


@pytest.mark.parametrize(("given", "count"), [("{}", 8), ("{modes: 12}", 12), ("{modes: 3, m2: 0.1}", 3)])
def test_a_field_that_is_added_by_hand_has_the_modes_that_were_said(config, tmp_path, given, count):
    write_text(config, with_effects(effects=f"  effects:\n    stiffness_field: {given}\n"))
    parameters = {name: {"value": value} for name, value in {"mu_top": 0.031, "mu_bottom": 0.062}.items()}
    keep_json(tmp_path / "results/study/base/estimate.json", {"parameters": parameters})
    found = stages.warm(load_settings(config)).starts()
    size = {f"stiffness_field.m{n}": 0.1 if "m2" in given and n == 2 else 0.0 for n in range(1, count + 1)}
    assert found == pytest.approx({"mu_top": 0.031, "mu_bottom": 0.062} | size)


# --- models that the data cannot tell from a richer one


def diagnosed(folder, model, named, outlined=None, **refits):
    """A diagnosis on the way, with the values of `mu_top` of the effects that were refitted, and with other sides.

    Intervals are from nine to eleven tenths of these.
    """

    def refit(**values):
        return {"parameters": values, "intervals": {name: [0.9 * v, 1.1 * v] for name, v in values.items()}}

    own = {"mu_bottom": 0.06, "compressibility.loss": 0.02}
    ranking = [{"effect": name, "refit": refit(mu_top=value, **own)} for name, value in refits.items()]
    data = {"ranking": ranking, "effects": named}
    if outlined:
        data["outlined"] = refit(mu_top=outlined, mu_bottom=0.06)
    keep_json(folder / f"results/study/{model}/diagnosis.json", data)


def test_models_that_could_not_be_told_from_it_stay_with_a_model(config, tmp_path):
    write_text(
        config,
        with_effects(
            effects="  effects:\n    compressibility: {loss: 0.01}\n    inclusion: {contrast: 0.7, along: 0.3}\n"
        ),
    )
    named, other = ["compressibility", "skin"], ["relaxation", "ageing"]
    diagnosed(tmp_path, "base", named, compressibility=0.03, skin=0.045, soft_bed=0.09)
    diagnosed(tmp_path, "base+compressibility", other, inclusion=0.03, relaxation=0.02, ageing=0.04)
    parameters = {
        name: {"value": value}
        for name, value in {"mu_top": 0.031, "mu_bottom": 0.062, "compressibility.loss": 0.017}.items()
    }
    keep_json(tmp_path / "results/study/base+compressibility/estimate.json", {"parameters": parameters})
    # an effect that is added though others were named has no rivals of its own; those of the first one stay
    assert stages.warm(load_settings(config)).model.rivals == {
        "base+skin": {"mu_top": pytest.approx((1.35, 1.65)), "mu_bottom": pytest.approx((0.9, 1.1))}
    }
    diagnosed(tmp_path, "base+compressibility", ["inclusion"], inclusion=0.03, relaxation=0.02)
    assert list(stages.warm(load_settings(config)).model.rivals) == ["base+skin"]
    diagnosed(tmp_path, "base+compressibility", ["ageing", "inclusion"], inclusion=0.04, ageing=0.02)
    found = stages.warm(load_settings(config)).model.rivals["base+compressibility+ageing"]
    assert found["mu_top"] == pytest.approx((0.45, 0.55))


def test_another_outline_is_a_rival_of_a_state_that_moves_the_sides(config, tmp_path):
    """It has no number, so that it is no candidate; the model with it was fitted all the same."""
    write_text(config, with_effects(effects="  effects:\n    compressibility: {loss: 0.01}\n"))
    parameters = {"mu_top": {"value": 0.031}, "mu_bottom": {"value": 0.062}}
    keep_json(tmp_path / "results/study/base/estimate.json", {"parameters": parameters})
    for named, known in (
        (["compressibility", OUTLINE], {"mu_top": pytest.approx((1.08, 1.32)), "mu_bottom": pytest.approx((0.9, 1.1))}),
        ([], None),
    ):
        diagnosed(tmp_path, "base", named, outlined=0.036, compressibility=0.03)
        rivals = stages.warm(load_settings(config)).model.rivals
        assert rivals == ({"base+outline": known} if known else {})


# --- what is told


def test_effects_are_listed_with_their_numbers(capsys):
    assert main(["effects"]) == 0
    blocks = {text.split(":")[0]: text.splitlines() for text in capsys.readouterr().out.split("\n\n")}
    assert blocks["tilt"][0] == "tilt: tilt of the indenter"
    assert "    slope: -0.6 to 0.6 of height / width, absent at 0" in blocks["tilt"]
    assert "    confirm: A photograph of the indenter's edge, or a spirit level on it." in blocks["tilt"]
    assert (
        "    needs: pictures or measured points, a flat side under the indenter, a body in the plane" in blocks["tilt"]
    )
    assert blocks["inclusion_in_space"][0] == "inclusion_in_space: inclusion in space"
    assert "    thickness: tried at 0.0416667, 0.0833333 of height; fitted from 0.0166667 to 0.208333" in blocks["skin"]
    assert "    layer: tried at 1, 2, 3, 4, 5, 6; not fitted" in blocks["split_layer"]
    assert "    needs: a prescribed force" in blocks["force_gain"]
    # in a study what is a share of it has its unit
    assert main(["effects", str(ROOT / "studies/phantom")]) == 0
    blocks = {text.split(":")[0]: text.splitlines() for text in capsys.readouterr().out.split("\n\n")}
    assert "    slope: -0.6 to 0.6, absent at 0" in blocks["tilt"]
    assert "    thickness: tried at 0.5, 1; fitted from 0.2 to 2.5" in blocks["skin"]


def test_effects_of_no_study_are_an_error(tmp_path, capsys):
    assert main(["effects", str(tmp_path / "nowhere")]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert "nowhere" in message


def test_errors_name_the_file_that_was_given(config, tmp_path):
    mine = tmp_path / "mine.yaml"
    for numbers, field in (
        ("tilt: {slop: 1}", "tilt.slop"),
        ("tlit: {}", "tlit"),
        ("fibres: {stiffness: 31}", "fibres.stiffness"),
    ):
        mine.write_text(with_effects(effects=f"  effects:\n    {numbers}\n").replace("study: study", "study: ."))
        with pytest.raises(FingerfitError) as caught:
            load_settings(mine)
        assert str(caught.value).startswith(f"{mine}: model.effects.{field}: ")


def test_a_misspelt_study_is_named(config, tmp_path):
    mine = tmp_path / "mine.yaml"
    mine.write_text(with_effects(effects="  effects:\n    own: {}\n").replace("study: study", "study: stdy"))
    with pytest.raises(InputError) as caught:
        load_settings(mine)
    assert str(caught.value) == f"{mine}: study: found stdy; expected the folder of a study"
    mine.write_text(with_effects(effects="  effects:\n    tilt: {}\n").replace("study: study", "study: stdy"))
    with pytest.raises(InputError) as caught:
        stages.check_model(load_settings(mine), mine)
    assert str(caught.value) == f"{mine}: study: found stdy; expected the folder of a study"


def rung(folder, model, effects=(), spare=(), error=2.284, verdict="adequate", numerics=""):
    """Results of a model that is there already."""
    counted = {"run": 9, "reused": 5}
    error = {"fitted": error, "held_out": None}
    keep_json(
        folder / model / "rung.json", {"model": model, "error": error, "simulations": counted, "sentence": "so it is"}
    )
    found = {
        "verdict": "missing" if effects else verdict,
        "effects": list(effects),
        "spare": list(spare),
        "numerics": numerics,
    }
    keep_json(folder / model / "diagnosis.json", {**found, "ranking": []})


SNAKEFILE = "rule diagnose:\n    output: touch('done')\n"


def test_discover_says_that_it_chose_and_how_each_rung_did(config, tmp_path, monkeypatch, capfd):
    """Results of two models that are there already: nothing runs but a workflow that has nothing to do."""
    write_text(tmp_path / "Snakefile", SNAKEFILE)
    write_text(tmp_path / "workflow/profiles/default/config.yaml", "cores: 1\nquiet: [all]\n")
    monkeypatch.setattr(call, "SHIPPED", tmp_path)
    rung(tmp_path / "results/study", "base", ["tilt", "skin"])
    rung(tmp_path / "results/study", "base+tilt")
    assert main(["discover"]) == 0
    assert capfd.readouterr().out.splitlines() == [
        "base: error 2.28 times the noise level; 9 simulations run, 5 reused from models below; so it is",
        "these data cannot tell tilt from skin: adding tilt, which fits best",
        "config.yaml: added tilt (tilt of the indenter)",
        "base+tilt: error 2.28 times the noise level; 9 simulations run, 5 reused from models below; so it is",
        "ladder: results/study/ladder.json; page: results/study/report.html",
    ]


@pytest.fixture
def fitted(monkeypatch):
    """A workflow that has nothing to do, as in the test above, without the seconds that Snakemake takes to say so."""
    monkeypatch.setattr(climb, "command", lambda *_: [sys.executable, "-c", ""])


@pytest.mark.parametrize(
    ("without", "needed"),
    [({}, False), ({"effects": ["tilt"]}, True), ({"effects": ["onset"]}, True), ({"verdict": "unexplained"}, True)],
    ids=["adequate", "it is missing", "another one is missing", "unexplained"],
)
def test_discover_drops_what_is_not_needed_beside_a_later_effect(without, needed, fitted, config, tmp_path, capfd):
    """Where the model is not adequate without it, it comes back as it was, and nothing is dropped any more."""
    study = tmp_path / "results/study"
    rung(study, "base", ["tilt"])
    rung(study, "base+tilt", ["skin"])
    rung(study, "base+tilt+skin", spare=["tilt"])
    rung(study, "base+skin", **without)
    assert main(["discover"]) == 0
    said = [line.partition(" (")[0] for line in capfd.readouterr().out.splitlines() if "error" not in line]
    more = ["without tilt the model is not adequate: tilt is taken back"] if needed else []
    assert said[:-1] == [
        "config.yaml: added tilt",
        "config.yaml: added skin",
        "tilt may not be needed beside the others: dropping it",
        "config.yaml: dropped tilt; its results stay where they are",
        *more,
    ]
    assert list(load_settings(config).model.effects) == (["tilt", "skin"] if needed else ["skin"])


def test_nothing_is_written_before_the_first_model(config, tmp_path, monkeypatch):
    """A folder of results outside of the workspace must be empty then."""
    monkeypatch.setattr(climb, "command", lambda *_: [sys.executable, "-c", "raise SystemExit(1)"])
    assert main(["discover"]) == 1
    assert [path.name for path in (tmp_path / "results").rglob("*") if path.is_file()] == []


@pytest.mark.parametrize("changed", [False, True])
def test_a_call_that_was_killed_goes_on_with_what_it_tried(changed, config, tmp_path, monkeypatch, capfd):
    """The effect that was dropped for a trial comes back; unless somebody has changed the config since."""
    study, codes = tmp_path / "results/study", [0, 0, 0, 1, 0, 0]
    monkeypatch.setattr(climb, "command", lambda *_: [sys.executable, "-c", f"raise SystemExit({codes.pop(0)})"])
    rung(study, "base", ["tilt"])
    rung(study, "base+tilt", ["skin"])
    rung(study, "base+tilt+skin", spare=["tilt"])
    rung(study, "base+skin", verdict="unexplained")
    assert main(["discover"]) == 1
    assert list(load_settings(config).model.effects) == ["skin"]
    if changed:
        config.write_text(config.read_text() + "# mine\n")
    assert main(["discover"]) == 0
    assert ("tilt is taken back" in capfd.readouterr().out) != changed
    assert list(load_settings(config).model.effects) == (["skin"] if changed else ["tilt", "skin"])
    assert not (study / climb.TRIED).exists()
    assert len(codes) == (1 if changed else 0)


@pytest.mark.parametrize(
    ("instead", "ends"),
    [
        (["gradient"], ["skin", "gradient"]),
        (["state_probe"], ["stiffness_field", "skin"]),
        ([], ["stiffness_field", "skin"]),
    ],
    ids=["a known effect", "no known form again", "nothing"],
)
def test_discover_looks_again_for_what_had_no_known_form(instead, ends, fitted, config, tmp_path, capfd):
    """Beside an effect that was added later, the first one may have a form that is known."""
    study, missing = tmp_path / "results/study", "missing" if instead else "unexplained"
    rung(study, "base", ["stiffness_field"])
    rung(study, "base+stiffness_field", ["skin"])
    rung(study, "base+stiffness_field+skin")
    rung(study, "base+skin", instead, verdict=missing)
    rung(study, "base+skin+gradient")
    assert main(["discover"]) == 0
    said = capfd.readouterr().out
    assert "stiffness_field has no known form, which may show beside the others: dropping it" in said
    assert ("taken back" in said) == (ends[0] == "stiffness_field")
    assert list(load_settings(config).model.effects) == ends


@pytest.mark.parametrize(("last", "done"), [("added", ["skin"]), ("dropped", [])])
def test_discover_says_what_it_did_last_to_a_model_that_is_not_fitted(
    last, done, fitted, config, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(climb, "RUNGS", 2)
    rung(tmp_path / "results/study", "base", ["tilt"])
    rung(tmp_path / "results/study", "base+tilt", done, spare=[] if done else ["tilt"])
    assert main(["discover"]) == 0
    assert f"stopped after 2 models; the last effect is {last}, but not fitted anew" in capfd.readouterr().out


@pytest.mark.parametrize(("refuses", "verdict"), [(False, "unexplained"), (True, "unexplained"), (False, "adequate")])
def test_discover_takes_finer_meshes_where_the_mesh_is_too_coarse(refuses, verdict, fitted, config, tmp_path, capfd):
    """At most twice; a mesh that cannot be changed stays, and the verdict with it."""
    if refuses:
        write_text(config, CONFIG.replace("across: 3", "across: 600"))
    rung(tmp_path / "results/study", "base", verdict=verdict, numerics="coarse_mesh")
    assert main(["discover"]) == 0
    said = [line for line in capfd.readouterr().out.splitlines() if "error 2" not in line]
    if refuses:
        assert said[0].startswith("the mesh stays as it is: config.yaml: model.mesh.across: found 1200; expected")
    else:
        assert said[:-1] == [
            "config.yaml: finer mesh, mesh: CPE8, across 6, per_layer 4",
            "config.yaml: finer mesh, mesh: CPE8, across 12, per_layer 8",
        ]
    assert said[-1] == "ladder: results/study/ladder.json; page: results/study/report.html"
    assert load_settings(config).model.mesh.across == (600 if refuses else 12)
    # load steps that are too large are for a person
    rung(tmp_path / "results/study", "base", verdict="unexplained", numerics="load_step")
    assert main(["discover"]) == 0
    assert "finer mesh" not in capfd.readouterr().out


@pytest.mark.parametrize(
    ("finer", "mesh", "taken"),
    [
        ("across: 6, per_layer: 4", "search", 3),
        ("across: 7, per_layer: 4", "search", 6),
        ("across: 6, per_layer: 4, grading: 2", "search", 6),
        ("across: 6, per_layer: 4", "refined", 6),
    ],
)
def test_a_mesh_as_fine_as_one_without_a_solution_is_not_tried(finer, mesh, taken, config, tmp_path):
    search = "  mesh: {element: CPE8, across: 3, per_layer: 2}\n"
    refined = search.replace("mesh", "refined").replace("across: 3, per_layer: 2", finer)
    write_text(config, CONFIG.replace(search, search + refined))
    keep_json(tmp_path / "results/study/base/estimate.json", {"sim_mesh": mesh})
    if taken == 3:
        with pytest.raises(InputError) as caught:
            ladder.refine(config)
        assert str(caught.value) == (
            "config.yaml: model.refined: found a mesh without a solution at the best guess;"
            " expected a solution there: the mesh of the search would become as fine"
        )
    else:
        ladder.refine(config)
    assert load_settings(config).model.mesh.across == taken


def test_discover_takes_a_mesh_back_that_has_no_fit(config, tmp_path, monkeypatch, capfd):
    """At glued corners a finer mesh may have no equilibrium: nothing is lost, and the verdict of the coarser one ends it."""
    write_text(tmp_path / "Snakefile", 'assert config["model"]["mesh"]["across"] == 3, "no equilibrium"\n' + SNAKEFILE)
    write_text(tmp_path / "workflow/profiles/default/config.yaml", "cores: 1\nquiet: [all]\n")
    monkeypatch.setattr(call, "SHIPPED", tmp_path)
    rung(tmp_path / "results/study", "base", numerics="coarse_mesh")
    before = config.read_text()
    assert main(["discover"]) == 0
    said = [line for line in capfd.readouterr().out.splitlines() if "error 2" not in line]
    assert said == [
        "config.yaml: finer mesh, mesh: CPE8, across 6, per_layer 4",
        "the fit on the finer mesh failed, for the reason above: the coarser mesh is taken back",
        "ladder: results/study/ladder.json; page: results/study/report.html",
    ]
    assert config.read_text() == before


@pytest.mark.parametrize(
    ("mesh", "found"),
    [
        ("", "none, but a mesh of the study's own"),
        ("  mesh: {element: C3D8, across: 3, per_layer: 2}\n", "C3D8, a brick"),
    ],
    ids=["of the study", "a brick"],
)
def test_a_mesh_that_is_no_block_in_the_plane_is_made_finer_by_hand(mesh, found, config):
    text = CONFIG.replace("  mesh: {element: CPE8, across: 3, per_layer: 2}\n", mesh)
    write_text(config, text)
    with pytest.raises(InputError, match=rf"^config.yaml: model.mesh: found {found}; expected a block in the plane"):
        ladder.refine(config)
    assert config.read_text() == text


def test_discover_takes_a_lens_in_place_of_sides_as_the_picture_shows_them(
    fitted, config, tmp_path, monkeypatch, capfd
):
    # the mesh would follow a picture, which is an empty file here
    monkeypatch.setattr(ladder, "_refuse", lambda *_: None)
    study = tmp_path / "results/study"
    rung(study, "base", ["outline"])
    rung(study, "base+outline", ["lens"])
    rung(study, "base+lens")
    assert main(["discover"]) == 0
    said = "lens says where the first picture shows the sides: outline, by which they lie there, is dropped"
    assert said in capfd.readouterr().out.splitlines()
    assert list(load_settings(config).model.effects) == ["lens"]
