"""Effects in config.yaml: whatever way a person wrote it, all else in it stays byte for byte."""

from pathlib import Path

import pytest
import yaml
from one_layer import TWO_TESTS

from fingerfit.core.errors import InputError, Problems
from fingerfit.diagnosis.ladder import add
from fingerfit.settings.config import load_settings
from fingerfit.settings.edit import remove_effect, write_effect, write_meshes
from fingerfit.settings.finer import finer_meshes

HEAD = "study: study\n"
MODEL = """\
model:          # of the body
  name: base
  material: {alpha: 1.4,   poisson: 0.49}
  mesh: {element: CPE8, across: 3,
         per_layer: 2}   # coarse
"""
PARAMETERS = """\
  parameters:
    mu_top:     &layer {unit: MPa, start: 1.0e-1, lower: 0.005, upper: 0.5}   # soft
    mu_bottom:  *layer
"""
FIT = """\
fit:
  score: "nmi"
  stages:
    - {name: 'grid', kind: grid, points: 4}
"""
BLOCK = """\
  effects:   # found so far
    # the first
    tilt: {slope: 0.012345678}   # from a photograph
    # the other one
    onset:
      offset: 0.1  # mm
"""
TILT, NEW = "    tilt: {slope: 0.012345678}   # from a photograph\n", "    friction: {coefficient: 0.25}\n"
BRACES = "  effects: {tilt: {slope: 0.012345678},  onset: {offset: 0.1 }}  # both\n"
OVER_LINES = """\
  effects: {
    tilt: {slope: 0.012345678},
    onset: {offset: 0.1},  # mm
    }
"""


def layout(inside, after="", before=PARAMETERS):
    return HEAD + MODEL + before + inside + after + FIT


def deeper(text):
    """The same with four spaces for two."""
    return "".join(" " * (len(line) - len(line.lstrip(" "))) + line for line in text.splitlines(keepends=True))


def quoted(text):
    return text.replace("model:", '"model":').replace("effects:", "'effects':").replace("onset:", '"onset":')


def aliased(text):
    return text.replace("lower: 0.005", "lower: &small 0.005").replace("slope: 0.012345678", "slope: *small")


ADDED = [BLOCK, BLOCK + NEW, BLOCK.replace(TILT, "")]
"""With two effects; with a third one; without the first one."""
CASES = {
    "one below the other": [layout(text) for text in ADDED],
    "before other keys": [layout(text, PARAMETERS, "") for text in ADDED],
    "a heading follows": [layout(text, "\n# ---- how it is fitted\n\n") for text in ADDED],
    "a comment in the block follows": [layout(text + "    # no others were tried\n") for text in ADDED],
    "four spaces": [deeper(layout(text)) for text in ADDED],
    "spaces that differ": [layout(text.replace("    ", "       ")) for text in ADDED],
    "line ends of Windows": [layout(text).replace("\n", "\r\n") for text in ADDED],
    "a byte order mark": ["\ufeff" + layout(text) for text in ADDED],
    "no newline at the end": [(HEAD + FIT + MODEL + PARAMETERS + text)[:-1] for text in ADDED],
    "neither, on Windows": [(HEAD + FIT + MODEL + PARAMETERS + text)[:-1].replace("\n", "\r\n") for text in ADDED],
    "marks of a document": [f"%YAML 1.1\n---\n{layout(text)}...\n" for text in ADDED],
    "keys in quotes": [quoted(layout(text)) for text in ADDED],
    "numbers by an alias": [aliased(layout(text)) for text in ADDED],
    "in braces": [
        layout(BRACES),
        layout(BRACES.replace(" }}", " }, friction: {coefficient: 0.25}}")),
        layout(BRACES.replace("tilt: {slope: 0.012345678},  ", "")),
    ],
    "in braces over lines": [
        layout(OVER_LINES),
        layout(OVER_LINES.replace("},  # mm", "}, friction: {coefficient: 0.25},  # mm")),
        layout(OVER_LINES.replace("tilt: {slope: 0.012345678},\n    ", "")),
    ],
}


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Path("config.yaml")


@pytest.mark.parametrize(("before", "more", "less"), CASES.values(), ids=CASES)
def test_all_else_stays(config, before, more, less):
    config.write_bytes(before.encode())
    known = load_settings(config).model.effects
    write_effect(config, "friction", {"coefficient": 0.25})
    assert config.read_bytes().decode() == more
    assert list(load_settings(config).model.effects.items()) == [*known.items(), ("friction", {"coefficient": 0.25})]
    remove_effect(config, "friction")
    assert config.read_bytes().decode() == before
    remove_effect(config, "tilt")
    assert config.read_bytes().decode() == less
    assert load_settings(config).model.effects == {"onset": {"offset": 0.1}}


@pytest.mark.parametrize("inside", ["", "  # effects: none yet\n"])
@pytest.mark.parametrize("written", [str, deeper], ids=["two spaces", "four spaces"])
def test_the_first_effect_comes_and_goes(config, inside, written):
    before = written(layout(inside, "\n# ---- how it is fitted\n\n"))
    config.write_text(before)
    write_effect(config, "tilt", {})
    head = before.split("    name: base" if written is deeper else "  name: base")[0]
    first = written("  effects:\n    tilt: {}\n")
    assert config.read_text() == head + first + before[len(head) :]
    remove_effect(config, "tilt")
    assert config.read_text() == before


def test_empty_braces_are_filled(config):
    config.write_text(layout("  effects: {}  # none yet\n"))
    write_effect(config, "tilt", {"slope": 0.01})
    assert config.read_text() == layout("  effects: {tilt: {slope: 0.01}}  # none yet\n")


SLIP, GAIN = "  effects:\n    base_slip: {share: 0.1}\n", "    force_gain: {gain: 0.1}\n"
PER_TEST = {
    "in brackets": ("  per_test: [force_gain, mu_top, force_gain.gain]  # own\n", "  per_test: [mu_top]  # own\n"),
    "nothing else": ("  per_test: [force_gain, force_gain.gain]\n", ""),
    "one below the other": (
        "  per_test:   # own\n    - mu_top\n    - force_gain.gain   # of the sensor\n    # in the end\n    - mu_bottom\n",
        "  per_test:   # own\n    - mu_top\n    # in the end\n    - mu_bottom\n",
    ),
    "of another effect": ("  per_test: [base_slip]\n", "  per_test: [base_slip]\n"),
}


@pytest.mark.parametrize(("before", "after"), PER_TEST.values(), ids=PER_TEST)
def test_what_each_test_has_for_itself_goes_with_its_effect(config, before, after):
    Path("study").mkdir()
    Path("study/study.yaml").write_text(yaml.safe_dump(TWO_TESTS))
    Path("study/steps.csv").write_text("step,displacement,force\n1,0.5,3\n")
    config.write_text(layout(before + SLIP + GAIN))
    remove_effect(config, "force_gain")
    assert config.read_text() == layout(after + SLIP)


def test_what_is_wrong_without_the_effect_is_told(config):
    rivals = "  rivals: {base+skin: {force_gain.gain: [0.1, 0.2]}}\n"
    config.write_text(layout(rivals + SLIP + GAIN))
    with pytest.raises(Problems, match=r"^config.yaml: model.rivals.base\+skin.force_gain.gain: found an unknown key"):
        remove_effect(config, "force_gain")
    assert config.read_text() == layout(rivals + SLIP + GAIN)


REFUSED = {
    "tilt goes, which another one repeats": (
        "remove",
        BLOCK.replace(TILT[4:], "tilt: &none {}\n").replace("\n      offset: 0.1", " *none"),
    ),
    "behind one that repeats another one": (
        "write",
        BLOCK.replace(TILT[4:], "tilt: &none {}\n").replace("\n      offset: 0.1", " *none"),
    ),
    "effects in an entry of a mapping": ("remove", "  ? effects\n  : tilt: {slope: 0.01}\n    onset: {offset: 0.1}\n"),
}


@pytest.mark.parametrize(("what", "inside"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_kept_is_refused_in_one_line(config, what, inside):
    config.write_text(layout(inside))
    assert list(load_settings(config).model.effects) == ["tilt", "onset"]
    with pytest.raises(InputError) as caught:
        remove_effect(config, "tilt") if what == "remove" else write_effect(config, "friction", {})
    assert str(caught.value) == (
        "config.yaml: model.effects: found anchors or a layout with which one effect cannot be changed alone;"
        " expected every effect written out, on lines of its own"
    )
    assert config.read_text() == layout(inside)


@pytest.mark.parametrize(
    ("solver_has", "mesh", "refined"),
    [
        ({"CPE4", "CPE8"}, "element: CPE8, across: 3,\n         per_layer: 2", "across: 5\n    element: CPE8"),
        ({"CPE4"}, "element: CPE4, across: 6,\n         per_layer: 4", "across: 10\n    element: CPE4"),
    ],
    ids=["quadratic", "halved"],
)
def test_finer_meshes_are_written_where_the_old_ones_stood(config, solver_has, mesh, refined):
    refine = "  refined:   # last steps\n    across: 5\n    element: CPE4   # linear\n    per_layer: &rows 2\n"
    text = HEAD + MODEL.replace("CPE8", "CPE4") + refine + PARAMETERS + FIT
    config.write_text(text)
    model = load_settings(config).model
    write_meshes(config, finer_meshes({"mesh": model.mesh, "refined": model.refined}, solver_has))
    found = load_settings(config).model
    halved = {} if "CPE8" in solver_has else {"per_layer: &rows 2": "per_layer: 4"}
    for old, new in {
        "element: CPE4, across: 3,\n         per_layer: 2": mesh, "across: 5\n    element: CPE4": refined, **halved
    }.items():  # fmt: skip
        text = text.replace(old, new)
    assert config.read_text() == text
    assert found.refined.per_layer == found.mesh.per_layer == (4 if halved else 2)


def test_a_mesh_that_another_one_repeats_stays(config):
    text = HEAD + MODEL.replace("mesh: {", "mesh: &same {").replace("   # coarse\n", "\n  refined: *same\n")
    config.write_text(text + PARAMETERS + FIT)
    with pytest.raises(InputError) as caught:
        write_meshes(config, finer_meshes({"mesh": load_settings(config).model.mesh}, {"CPE8"}))
    assert str(caught.value) == (
        "config.yaml: model.mesh: found anchors or a layout with which one mesh cannot be changed alone;"
        " expected every mesh written out, on lines of its own"
    )
    assert config.read_text() == text + PARAMETERS + FIT


def test_where_the_study_is_not_found_nothing_is_added(tmp_path, monkeypatch):
    """`study` is seen from the folder of the call, not from that of config.yaml."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    text = HEAD + MODEL + PARAMETERS + FIT
    (tmp_path / "config.yaml").write_text(text)
    found = r"config.yaml: study: found study, where there is no study.yaml; expected the folder of a study, seen"
    with pytest.raises(InputError, match=found):
        add(Path("../config.yaml"), "tilt")
    assert (tmp_path / "config.yaml").read_text() == text
