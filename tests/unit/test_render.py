"""From a template and a guess to a deck: strict, sandboxed, same guess same text."""

from pathlib import Path

import pytest

from fingerfit.core.errors import InputError
from fingerfit.deck.context import deck_context
from fingerfit.deck.render import render_deck
from fingerfit.mesh.blocks import layered_block
from fingerfit.study.study import Body, Layer, Noise, Step, Study

ROOT = Path(__file__).resolve().parents[2]
LAYERS = (("top", 4.0), ("bottom", 8.0))


@pytest.fixture
def context():
    steps = (Step(1, force=7.0, displacement=0.5), Step(2, force=14.5, displacement=1.0))
    body = Body(tuple(Layer(*layer) for layer in LAYERS), width=12.0, thickness=70.0)
    study = Study(Path("study.yaml"), "two layers", "force", steps, None, Noise(), body, "held", "glued")
    mesh = layered_block(12.0, LAYERS, 2, 1)
    material = {"alpha": 1.4, "alpha_bottom": 2.0, "poisson": 0.49, "mu": 0.5}
    return deck_context(study, mesh, "m.inp", {"mu_top": 0.02, "mu": 0.06}, material)


def render(folder, text, context):
    (folder / "own.j2").write_text(text)
    return render_deck("own.j2", context, [folder])


def test_constants_of_a_layer_go_before_common_ones_and_the_guess_before_fixed_ones(context):
    top, bottom = context["layers"]
    assert (top["name"], top["mu"], top["alpha"], top["poisson"]) == ("TOP", 0.02, 1.4, 0.49)
    assert (bottom["name"], bottom["mu"], bottom["alpha"]) == ("BOTTOM", 0.06, 2.0)


def test_compressibility_follows_from_poisson(context):
    top = context["layers"][0]
    bulk = 2 / top["d"]
    # nu = (3 K - 2 mu) / (6 K + 2 mu)
    assert (3 * bulk - 2 * top["mu"]) / (6 * bulk + 2 * top["mu"]) == pytest.approx(0.49, rel=1e-12)


def test_nodes_are_counted_from_one(context):
    mesh = layered_block(12.0, LAYERS, 2, 1)
    assert context["indenter"] == mesh.node_sets["INDENTER"][0] + 1
    assert context["top"] == [node + 1 for node in mesh.node_sets["TOP"]]


def test_a_constant_that_nobody_gives_is_told():
    body = Body((Layer("top", 4.0),), width=12.0)
    study = Study(Path("s"), "t", "force", (Step(1, force=1.0),), None, Noise(), body, "held", "glued")
    with pytest.raises(
        InputError, match=r"model.material.alpha: found nothing; expected a value of alpha for layer top"
    ):
        deck_context(study, layered_block(12.0, [("top", 4.0)], 2, 1), "m", {"mu": 1.0}, {"poisson": 0.4})


def test_a_deck_names_its_mesh_materials_and_every_step(context):
    deck = render_deck("block.inp.j2", context, [ROOT / "templates"])
    assert "*INCLUDE, INPUT=m.inp" in deck
    assert deck.count("*STEP, NLGEOM") == deck.count("*END STEP") == 2
    assert deck.count("*HYPERELASTIC, OGDEN") == 2
    assert f"0.02, 1.4, {context['layers'][0]['d']:.12g}" in deck
    assert [line for line in deck.splitlines() if not line.strip()] == []


def test_numbers_have_twelve_digits_and_a_guess_one_text(context):
    deck = render_deck("block.inp.j2", context, [ROOT / "templates"])
    assert render_deck("block.inp.j2", context, [ROOT / "templates"]) == deck
    context["layers"][0]["mu"] = 0.02 * (1 + 1e-14)
    assert render_deck("block.inp.j2", context, [ROOT / "templates"]) == deck
    context["layers"][0]["mu"] = 0.02 * (1 + 1e-9)
    assert render_deck("block.inp.j2", context, [ROOT / "templates"]) != deck


def test_the_first_folder_goes_first(tmp_path, context):
    (tmp_path / "block.inp.j2").write_text("mine {{ title }}")
    assert render_deck("block.inp.j2", context, [tmp_path, ROOT / "templates"]) == "mine two layers\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("*STEP\n\n{{ layers[0].nu }}", "line 3: found 'dict object' has no attribute 'nu'"),
        ("{{ titel }}", "line 1: found 'titel' is undefined"),
        ("a\n{% for x in steps %}", "line 2: found Unexpected end of template"),
        ("{% include 'no.j2' %}", "found no file no.j2"),
        ("{{ ''.__class__.__mro__[1].__subclasses__() }}", "line 1: found access to attribute '__class__'"),
        ("{{ 1 / 0 }}", "line 1: found division by zero"),
    ],
)
def test_a_wrong_template_is_one_line_with_its_place(tmp_path, context, text, says):
    with pytest.raises(InputError) as raised:
        render(tmp_path, text, context)
    assert says in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1
