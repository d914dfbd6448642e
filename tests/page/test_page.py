"""The report page: what is in it, that nothing injects, and how it behaves in a browser."""

import html
import importlib.util
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from fingerfit.core.errors import StateError
from fingerfit.core.files import keep_json, read_json, read_npz, write_npz
from fingerfit.model.catalogue import catalogue
from fingerfit.report.page import ladder_figure, panels, write_page
from fingerfit.report.page.figures import curve_panel, force_figure, stiffness_figure
from fingerfit.report.page.inputs import Compare, Inputs, Model, read_compare, read_inputs
from fingerfit.report.page.panels import Panels
from fingerfit.report.page.regions import places
from fingerfit.report.page.words import headline, place_words

_spec = importlib.util.spec_from_file_location("sample", Path(__file__).with_name("sample.py"))
sample = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(sample)
HOSTILE = "</script><img src=x onerror=alert(1)> $\\frac{"


def page(folder, **options):
    sample.write(folder / "hidden-tilt", **options)
    write_page(folder / "hidden-tilt", folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


def data_of(text):
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return page(tmp_path_factory.mktemp("page"))


def test_sections_and_numbers(whole):
    for name in ("compare", "fails", "missing", "ladder", "provenance"):
        assert f'<section id="{name}">' in whole
    assert "The model “base+tilt” explains the measurements" in whole
    assert "The residual is 1.01 times the noise level; it was 2.71 times with base." in whole
    assert (
        "These data would not show: Force gain. Not tried, for lack of what they need: Relaxation (needs a time at every step)."
        in whole
    )
    assert "44 reused" in whole and "held out" in whole


def test_measurements_that_would_identify_a_constant_stand_below_it(whole):
    text = re.search(r"<h3>A measurement that would identify mu_bottom</h3>(.*?)</table>", whole, re.S)[1]
    assert re.findall(r"<td>(.*?)</td>", text) == [
        "as measured", "0.02 to 0.3", "not identified",
        "the same test to 1.2 times the force", "0.06 to 0.07", "identified",
    ]  # fmt: skip


def test_profiles_of_these_settings_are_shown(tmp_path):
    sample.write(tmp_path / "study")
    made, file = "these", tmp_path / "study/ladder.json"
    ladder = read_json(file)
    ladder["rungs"][-1]["made_with"] = made
    keep_json(file, ladder)
    one = {"unit": "MPa", "interval95": [None, 0.03], "ends": ["bound", "risen"], "sentence": "mu_top is not identified below",
           "points": [{"values": {"mu_top": mu}, "rise": rise} for mu, rise in ((0.01, 1.0), (0.02, 0.0), (0.04, 5.0))]}  # fmt: skip
    for name, written in (("mu_top", made), ("mu_middle", "others")):
        keep_json(tmp_path / f"study/base+tilt/profile_{name}.json", {**one, "constant": name, "made_with": written})
    write_page(tmp_path / "study", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<h3>Profile of mu_top</h3>" in text and "mu_top is not identified below." in text
    assert "Profile of mu_middle" not in text


def test_a_mesh_that_is_too_coarse_is_told_with_its_cure(tmp_path):
    sample.write(tmp_path / "study", done=False)
    file = tmp_path / "study/base/diagnosis.json"
    said = "the mesh is too coarse: half the element size explains 90 % of the misfit; take a finer model.mesh"
    said += "; not tried, since solver abaqus or the deck lacks what they need: tilt"
    keep_json(file, read_json(file) | {"verdict": "unexplained", "effects": [], "family": "numerics", "sentence": said})
    write_page(tmp_path / "study", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "does not explain the measurements: the mesh is too coarse." in text
    assert "Take a finer model.mesh, and fit again." in text
    assert "Not solved well enough: take a finer model.mesh" in text
    assert "describe an effect of your own" not in text


def test_an_adequate_model_with_ranges_is_said_to_be_in_doubt(tmp_path):
    sample.write(tmp_path / "study")
    ladder = read_json(tmp_path / "study/ladder.json")
    last = ladder["rungs"][-1]
    last["ranges"] = {name: [0.5 * entry["value"], 2.0 * entry["value"]] for name, entry in last["parameters"].items()}
    keep_json(tmp_path / "study/ladder.json", ladder)
    write_page(tmp_path / "study", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "leaves no more than what the form of its own effects may be off by." in text
    assert "With the model in doubt" in text
    assert "as well as their noise allows" not in text


def test_an_adequate_model_says_what_is_not_excluded_and_how_far_its_intervals_reach_then(tmp_path):
    sample.write(tmp_path / "study")
    ladder = read_json(tmp_path / "study/ladder.json")
    last = ladder["rungs"][-1]
    reach = {name: [0.5 * entry["value"], 2.0 * entry["value"]] for name, entry in last["parameters"].items()}
    last["not_excluded"] = {"effects": ["stiffness that changes", "tilt <b>"], "ranges": reach}
    keep_json(tmp_path / "study/ladder.json", ladder)
    write_page(tmp_path / "study", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    table = re.search(r'<table class="found">(.*?)</table>', text, re.S)[1]
    assert "<th>With effects that are not excluded</th>" in table
    assert "<td>0.0106 to 0.0424</td>" in table
    assert "Not excluded: stiffness that changes; tilt &lt;b&gt;." in text


def test_it_begins_with_the_constants_and_their_intervals(whole, tmp_path):
    def top(text):
        return re.search(r'<table class="found">(.*?)</table>', text, re.S)[1]

    assert whole.index('<table class="found">') < whole.index('<section id="compare">')
    rows = re.findall(r"<td>(\w+).*?<b>(.*?)</b>.*?<td>(.*?)</td>", top(whole))
    assert [name for name, *_ in rows] == ["mu_top", "mu_middle", "mu_bottom", "tilt"]
    assert rows[0][1] == "0.0212"
    low, high = map(float, rows[0][2].split(" to "))
    assert low < 0.0212 < high
    assert "assume" not in top(whole)
    assert "their intervals assume that it is right, and it is not" in top(page(tmp_path, done=False))


def test_focus_is_seen_and_phones_have_buttons_for_thumbs(whole):
    """WCAG 2.2: 3 to 1 between a focus ring and what is around it; 44 px, its enhanced size of targets."""
    colours = dict(re.findall(r"--(\w+): (#\w{6})", whole))
    ring = re.search(r":focus-visible \{ outline: (\d)px solid var\(--(\w+)\)", whole)
    channels = [int(colours[ring[2]][n : n + 2], 16) / 255 for n in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    assert 1.05 / (float(np.dot(linear, (0.2126, 0.7152, 0.0722))) + 0.05) > 3
    assert int(ring[1]) >= 2
    narrow = whole[whole.index("@media (max-width: 760px)") :]
    assert re.search(r"button, button\.row, [^{]*\{ min-height: 44px; \}", narrow)
    # a summary that is no list item has no triangle of the browser's
    assert re.search(r"summary, [^{]*\{ display: inline-flex;", narrow)
    assert re.search(
        r"summary::before \{ content: \"▸\";.*details\[open\] > summary::before \{ content: \"▾\";", narrow
    )


def test_the_lines_to_type_are_understood(whole):
    """By the program that they start, as they stand on the page; an installed package has no Snakefile to call."""
    from fingerfit.cli import _parser

    add, again = (html.unescape(line) for line in re.findall(r'<code class="line">(.*?)</code>', whole))
    assert shlex.split(add)[0] == shlex.split(again)[0] == "fingerfit"
    asked = _parser().parse_args(shlex.split(add)[1:])
    assert asked.effect == "tilt" and str(asked.config) == "YOURS.yaml"
    run = _parser().parse_args(shlex.split(again)[1:])
    assert run.diagnose and str(run.config) == "YOURS.yaml"


def test_words_for_numbers_and_places(whole):
    table = re.search(r'<table class="candidates">.*?</table>', whole, re.S)[0]
    for words in ("contrast", " = 0.", "at at"):
        assert words not in table
    assert "inclusion 1.22 times" in table and "at 85 % of the width, at 50 % of the height" in table
    assert "0.5 mm thick" in table and "in the layer top" in table
    assert table.count("the fitted constants can absorb it here") == 1
    assert (
        "is missing. missing" not in whole.lower()
        and "put a level on the indenter" in whole.split('<table class="candidates">')[0]
    )


def test_words_of_effects_are_plain_whatever_their_numbers_are():
    """All that ship: no sign is left of their templates, and shares have their per cent."""
    effects = catalogue()
    for effect in effects.values():
        for number in effect.scan:
            for value in (*effect.scan[number], *effect.refine.get(number, ())):
                words = place_words({number: value}, effect.told, ["skin", "fat", "gel"])
                assert words and not set("{};|=") & set(words.replace("x = ", "").replace("y = ", "")), words
        assert not re.search(r"\{percent\}(?! %)", " ".join(effect.told.values())), effect.name

    def said(effect, **place):
        return place_words(place, effects[effect].told)

    assert said("wall", side=-1, gap=0.2) == "on the left, 0.2 mm away"
    assert said("turned_pictures", growing=1) == "growing from step to step"
    assert said("swelling", settling=0) == "at an even pace (settling 0)"
    assert said("swelling", settling=-1.5).startswith("slow at first")
    assert said("ellipse", flat=0.76).startswith("longer along the layers")
    assert said("jumping_pictures", numbers=1) == "numbers that are fitted, two for each step: 1"


def test_the_order_of_candidates_is_said_and_what_a_search_that_did_not_end_is(tmp_path):
    sample.write(tmp_path / "study", done=False)
    file = tmp_path / "study/base/diagnosis.json"
    ended = "“Search not ended”: the first pass stopped before it found a minimum"

    def text():
        write_page(tmp_path / "study", tmp_path / "report.html")
        return (tmp_path / "report.html").read_text(encoding="utf-8")

    assert "In the order of the odds for each after the first pass" in text() and ended not in text()
    found = read_json(file)
    found["ranking"][0]["first_pass"] = {"converged": False, "at_bound": [], "log_odds": 3.0}
    keep_json(file, found)
    assert ended in text()


def test_how_base_and_indenter_move_is_drawn_where_they_do(tmp_path):
    """Of the indenter without its mean, which is the load's: one that only comes down has no picture."""
    file, page = tmp_path / "study/base/compare.npz", tmp_path / "report.html"
    sample.write(tmp_path / "study", done=False)
    known, x = read_npz(file), np.linspace(0.0, 12.0, 5)
    still, slips, tilts = (
        np.zeros((5, 2)),
        np.stack([0.1 * x, 0 * x], axis=1),
        np.stack([0 * x, 0.02 * x - 2.0], axis=1),
    )

    def drawn(*sides):
        rows = [np.column_stack([np.full(5, side), x, moved]) for side, moved in enumerate(sides)]
        write_npz(file, {**known, "edge_moved": np.concatenate(rows)})
        write_page(tmp_path / "study", page)
        text = page.read_text(encoding="utf-8")
        return [edge for edge in ("base", "indenter") if f'alt="displacement along the {edge}"' in text]

    assert drawn(still, still - 2.0) == []
    assert drawn(slips, still - 2.0) == ["base"]
    assert drawn(still, tilts) == ["indenter"]
    assert drawn(slips, tilts) == ["base", "indenter"]


def test_the_family_of_what_is_named_is_told_with_its_odds_by_refits(tmp_path):
    sample.write(tmp_path / "study", done=False)
    file, page = tmp_path / "study/base/diagnosis.json", tmp_path / "report.html"

    def text():
        write_page(tmp_path / "study", page)
        return page.read_text(encoding="utf-8")

    told = "The effect lies in the indenter and other boundaries, by odds of 10^5 to 1 against stiffness from place to place."
    assert told in text() and "<b>the best</b>" in text() and "1 to 10^5" in text()
    found = read_json(file)
    found["families"][1]["refit"] = None
    found["ranking"][2] |= {"refit": {"error": {"fitted": 3.0, "held_out": 3.0}, "parameters": {}, "missed": True}}
    keep_json(file, found)
    assert "no effect of another family was likely enough to be refitted" in text()
    assert "found no minimum: does not count" in text()
    found["ranking"][2]["family"] = "structure"
    keep_json(file, found)
    assert "The effect lies in the indenter and other boundaries; the refits of others do not count." in text()
    keep_json(file, {**found, "families": []})
    assert "The effect lies in" not in text()


def test_regions_begin_where_the_body_does():
    """Patches of measured points begin a hair below it."""
    found = sample.compare(sample.TILT)
    found["patch_centre"] = found["patch_centre"] - [0.0, 8e-6]
    lowest = min(
        places(Compare(**{k: v for k, v in found.items() if k in Compare.__dataclass_fields__})), key=lambda p: p.low
    )
    assert (lowest.low, lowest.high) == (0.0, 1.2)


def test_nothing_is_loaded_from_elsewhere(whole):
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:|//|file:)""", whole)
    assert "url(" not in whole and "@import" not in whole and "fetch(" not in whole
    assert "default-src 'none'" in whole


def test_every_picture_of_every_model_is_there_once(whole):
    data = data_of(whole)
    for model in ("base", "base+tilt"):
        for panel in ("measured", "synthesized", "difference", "map"):
            assert all(f"{panel}|{model}|{n}" in data["panels"] for n in range(4))
    assert all(f"pattern|base|{n}|{effect}" in data["panels"] for n in range(4) for effect in ("tilt", "indenter_slip"))
    assert "pattern|base|3|intensity_drift" in data["panels"] and "pattern|base|steps|onset" in data["panels"]
    assert "pattern|base|3|onset" not in data["panels"]
    assert data["panels"]["measured|base|2"] == data["panels"]["measured|base+tilt|2"]
    assert len(set(data["uris"])) == len(data["uris"])
    assert all(uri.startswith("data:image/png;base64,") for uri in data["uris"])


def test_the_residual_has_its_own_scale_whatever_effects_explain(tmp_path):
    """One that goes beyond all bounds made it white; and the same residual has the same colours in both sections."""
    sample.write(tmp_path / "study", done=False)

    def panels_of():
        return Panels(read_inputs(tmp_path / "study").models)

    file = tmp_path / "study/base/diagnosis.npz"
    found, before = read_npz(file), panels_of()
    write_npz(file, {**found, "residual_displacement_skin": 1e20 * found["residual_displacement_skin"]})
    after = panels_of()
    for n in range(len(sample.PICTURES)):
        there = after.uris[after.keys[f"there|base|{n}|residual_displacement"]]
        assert there == before.uris[before.keys[f"there|base|{n}|residual_displacement"]]
        assert there == after.uris[after.keys[f"map|base|{n}"]]


def test_the_caption_of_the_constants_names_the_model_as_the_headline_does(whole):
    assert (
        "The model “base+tilt” explains" in whole and "<caption>Constants of the model “base+tilt”</caption>" in whole
    )


def test_the_worst_region_comes_first(whole):
    ratios = re.search(r'<div data-for="base">\s*<p>Residual displacement.*?</table>', whole, re.S)[0]
    found = [float(x) for x in re.findall(r"<small>([\d.]+) ×</small>", ratios)]
    assert len(found) == 40 and found == sorted(found, reverse=True) and found[0] > 5


def test_nothing_is_explained_of_a_misfit_that_is_noise(whole):
    """The base model has a misfit to explain, the adequate one of 611 for 600 has none."""
    base, adequate = re.findall(r'<table class="candidates">.*?</table>', whole, re.S)
    refits = base.count('<td data-label="Refit explains"><span class="share">')
    assert (
        refits == 1
        and "87 %" in base.split('<td data-label="Refit explains"><span class="share">')[1].partition("</td>")[0]
    )
    assert base.count('<span class="track short">') == base.count('data-label="First pass explains"') + refits > 5
    assert '<td data-label="First pass explains">–' in adequate


@pytest.mark.parametrize("known", [True, False])
def test_labels_of_the_force_fit_their_axes(tmp_path, known):
    """Without a response there is no empty space below."""
    found = sample.compare(sample.TILT)
    sample.save(tmp_path / "compare.npz", found if known else {**found, "response": np.full(len(sample.STEPS), np.nan)})
    figure = force_figure(read_compare(tmp_path / "compare.npz"))
    for _ in range(2):  # the second time where the layout of the first one has put the axes
        figure.canvas.draw()
    assert len(figure.axes) == 1 + known
    for axes in figure.axes:
        label, box = axes.yaxis.label.get_window_extent(), axes.get_window_extent()
        assert label.y0 >= box.y0 - 1 and label.y1 <= box.y1 + 1
    assert figure.axes[-1].get_tightbbox().y0 < 0.05 * figure.bbox.height


@pytest.mark.parametrize(("wide", "high", "down"), [(20, 8, 6), (12, 12, 6), (20, 6, 12)])
def test_places_of_stiffness_do_not_lie_over_each_other(wide, high, down):
    """Neither their marks nor their numbers, in a flat body as well; labels keep away from the numbers of the axes."""
    corners = np.array([[0, 0], [wide, 0], [wide, high], [0, high]], float)
    body = Compare(
        patch_centre=corners / 2 + [wide / 4, high / 4], patch_count=np.array([2, 2]), mesh_points=corners,
        mesh_rings=np.arange(4)[None], mesh_layer=np.zeros(1, int),
    )  # fmt: skip
    x, y = np.meshgrid(np.linspace(0.15, 0.85, 5) * wide, np.linspace(0.12, 0.88, down) * high)
    figure = stiffness_figure(body, np.stack([x.ravel(), y.ravel(), np.full(x.size, np.log(3.15)), x.ravel()], axis=1))
    figure.set_dpi(72)
    figure.draw_without_rendering()
    axes = figure.axes[0]
    (marks,) = (one for one in axes.collections if len(one.get_offsets()) == x.size)
    at = axes.transData.transform(marks.get_offsets())
    size = np.array([marks.get_widths()[0], marks.get_heights()[0]])
    apart = np.abs(at[:, None] - at)[np.triu_indices(len(at), 1)]
    assert (apart > size).any(axis=1).all()
    figure.set_dpi(720)  # older matplotlib measures text in whole pixels
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert not any(one.overlaps(other) for n, one in enumerate(boxes) for other in boxes[n + 1 :])
    low, top = axes.get_ylim()
    shown = [t.get_window_extent() for t in axes.get_yticklabels() if low <= t.get_position()[1] <= top]
    label = axes.yaxis.label.get_window_extent()
    assert shown and label.x0 >= 0 and all(label.x1 < tick.x0 - 30 for tick in shown)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The page of the first rung, whose constants ended at their bounds; a layer has a hostile name."""
    folder = tmp_path_factory.mktemp("first")
    sample.write(folder, names=(HOSTILE, "middle", "bottom"), done=False)
    rungs, diagnosis = (read_json(folder / f) for f in ("ladder.json", "base/diagnosis.json"))
    rungs["rungs"][0]["parameters"]["mu_top"]["at_bound"] = "upper"
    refit = next(entry["refit"] for entry in diagnosis["ranking"] if entry["effect"] == "tilt")
    refit["at_bound"] = {"slope": "lower"}
    keep_json(folder / "ladder.json", rungs)
    keep_json(folder / "base/diagnosis.json", diagnosis)
    write_page(folder, folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8")


def test_names_of_layers_do_not_inject(first):
    assert "<img src=x" not in first and html.escape(HOSTILE, quote=False)[:20] in first
    assert data_of(first)["meshes"]["base"]["names"][0] == HOSTILE


def test_only_compare_gives_a_page(tmp_path):
    text = page(tmp_path, only_compare=True)
    assert "has no diagnosis yet" in text and "There is no ladder yet" in text
    assert "map|base|3" in data_of(text)["panels"]


def test_only_forces_give_a_page(tmp_path):
    keep = ("step", "force", "displacement", "force_model", "displacement_model", "force_noise", "displacement_noise",
            "response", "response_noise", "control", "step_fitted")  # fmt: skip
    found = sample.compare(sample.TILT)
    arrays = {k: found[k] for k in keep} | {
        k: found[k][:0]
        for k in (
            "measured",
            "synthesized",
            "picture_step",
            "fitted",
            "error",
            "floor",
            "residual_displacement",
            "residual_displacement_noise",
            "mesh_moved",
        )
    }
    sample.save(tmp_path / "s/base/compare.npz", arrays)
    write_page(tmp_path / "s", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    table = re.search(r'<table class="left-by-step">.*?</table>', text, re.S)[0]
    assert re.findall(r"<td>step (\d) <small>([a-z ]+)<", table)[4] == ("5", "held out") and table.count("<tr>") == 8
    assert (
        "0.0205" in table
        and "clearly above the noise" in table
        and "there|base|steps|response" in data_of(text)["panels"]
    )
    assert "This study has no pictures" in text and "force|base" in data_of(text)["panels"]


def test_nothing_there_is_an_error_in_words(tmp_path):
    with pytest.raises(StateError, match="no model was compared"):
        write_page(tmp_path, tmp_path / "report.html")


def test_the_ladder_shows_the_noise_and_both_errors():
    axes = ladder_figure(sample.ladder()).axes[0]
    lines = {line.get_label(): list(line.get_ydata()) for line in axes.get_lines()}
    assert lines["fitted"] == [2.71, 1.01] and lines["held out"] == [3.02, 1.04]
    assert [1.0, 1.0] in lines.values()


CLICKS = """
const out = {}, shot = (p) => document.querySelector(`#viewer img[data-panel=${p}]`).src;
const uri = (k) => data.uris[data.panels[k]];
const data = JSON.parse(document.getElementById("data").textContent);
const step = () => document.getElementById("step-name").textContent, slider = document.getElementById("slider");
out.start = step();
document.querySelector('button[data-model="base"]').click();
out.model = shot("synthesized") === uri("synthesized|base|3");
slider.value = 2; slider.dispatchEvent(new Event("input"));
out.slid = step(); out.picture = shot("measured") === uri("measured|base|2");
document.getElementById("mesh").click();
out.mesh = document.querySelectorAll("#viewer svg.over path").length;
const row = document.querySelector('[data-for="base"] tr[data-region][data-picture-step="0"]');
row.click();
out.row = step(); out.chosen = row.classList.contains("chosen");
const map = document.querySelector('#fails [data-for="base"] img[data-panel=map]');
out.map = map.src === uri("map|base|0"); out.framed = document.querySelectorAll('#fails [data-for="base"] .over-map path').length;
out.inView = map.getBoundingClientRect().top >= 0 && map.getBoundingClientRect().top < innerHeight;
const pattern = document.querySelector('[data-for="base"] img[data-panel=pattern]');
const there = document.querySelector('[data-for="base"] img[data-panel=there]');
out.named = pattern.src === uri("pattern|base|0|tilt");
const drawn = ["tilt", "indenter_slip", "inclusion", "skin", "intensity_drift", "onset", "gradient"];
const rows = Array.from(document.querySelectorAll('[data-for="base"] tr[data-effect]'));
out.clickable = rows.map((r) => r.dataset.effect).sort().join() === drawn.sort().join();
for (const row of rows) {
  const effect = row.dataset.effect, curve = effect === "onset";
  row.scrollIntoView({ block: "start" });
  row.querySelector("button").click();
  out["pattern of " + effect] = pattern.src === uri(`pattern|base|${curve ? "steps" : 0}|${effect}`) && !pattern.closest("figure").hidden;
  const part = { onset: "steps|onset", intensity_drift: "0|brightness" }[effect] || "0|residual_displacement";
  out["there of " + effect] = there.src === uri(`there|base|${part}`) && !there.closest("figure").hidden;
  const box = there.getBoundingClientRect();
  out["view of " + effect] = box.bottom > 0 && box.top < innerHeight;
}
out.wide = document.documentElement.scrollWidth <= innerWidth;
out.innerWidth = innerWidth;
const blink = document.getElementById("blink"), seen = [];
blink.click();
const watch = setInterval(() => seen.push(document.getElementById("blink-shot").src === uri("measured|base|0")), 350);
setTimeout(() => {
  clearInterval(watch); blink.click();
  out.blinked = seen.includes(true) && seen.includes(false);
  out.stopped = document.getElementById("blink-name").textContent;
  const pre = document.createElement("pre");
  pre.id = "result"; pre.textContent = JSON.stringify(out); (parent || window).document.body.append(pre);
}, 4000);
"""


@pytest.mark.parametrize("width", [1440, 420])
def test_in_a_browser(whole, tmp_path, width):
    binary = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
    if binary is None:
        pytest.skip("no Chromium is installed: the page is not tried in a browser")
    # the page's policy runs no script but its own: the copy under test goes without
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", whole)
    path = tmp_path / "report.html"
    text = text.replace("</body>", f"<script>{{{CLICKS}}}</script></body>")
    # a window is 500 pixels wide or more; a frame in it may be narrower
    frame = f'<iframe style="border:0" width="{width}" height="1000" srcdoc="{html.escape(text)}"></iframe>'
    path.write_text(f"<!DOCTYPE html><meta charset='utf-8'><body>{frame}</body>", encoding="utf-8")
    run = subprocess.run(
        [binary, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width + 100},1100",
         "--virtual-time-budget=8000", "--dump-dom", path.as_uri()],
        capture_output=True, text=True, encoding="utf-8", timeout=120, check=True,
    )  # fmt: skip
    found = json.loads(html.unescape(re.search(r'<pre id="result">(.*?)</pre>', run.stdout, re.S)[1]))
    assert found.pop("mesh") == 9 and found.pop("framed") == 10
    assert found.pop("start") == "step 7 (fitted)" and found.pop("slid") == "step 5 (held out)"
    assert found.pop("row") == "step 1 (fitted)" and found.pop("stopped") == "Synthesized"
    assert found.pop("innerWidth") == width
    assert all(found.values()), found


def test_a_switch_between_tests(tmp_path):
    """Each test has its own pictures and tables; what is said of the model is said once."""
    sample.write(tmp_path, done=False)
    path, tests = tmp_path / "base/compare.npz", ("plate", "ball")
    first, second = (sample.compare(tilt, seed=seed) for tilt, seed in ((0.045, 3), (0.02, 4)))
    arrays = {
        f"{key}@{name}": value for name, own in zip(tests, (first, second), strict=True) for key, value in own.items()
    }
    sample.save(path, {"tests": np.array(tests), **arrays})
    write_page(tmp_path, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<button type="button" data-choose="(\w+)">', text) == list(tests)
    data = data_of(text)
    assert [one["test"] for one in data["tests"]] == list(tests)
    shown = [data["uris"][one["panels"]["difference|base|3"]] for one in data["tests"]]
    assert shown[0] != shown[1]
    assert len(re.findall(r'<div data-for="base" data-test="ball">', text)) == 3
    assert text.count('<table class="found">') == 1


def test_its_own_policy_lets_the_page_run(whole, tmp_path):
    binary = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
    if binary is None:
        pytest.skip("no Chromium is installed: the page is not tried in a browser")
    (tmp_path / "report.html").write_text(whole, encoding="utf-8")
    run = subprocess.run(
        [binary, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}", "--virtual-time-budget=3000",
         "--dump-dom", (tmp_path / "report.html").as_uri()],
        capture_output=True, text=True, encoding="utf-8", timeout=120, check=True,
    )  # fmt: skip
    assert 'id="step-name" for="slider">step 7 (fitted)<' in run.stdout or re.search(
        r"<output[^>]*step-name[^>]*>step 7 \(fitted\)<", run.stdout
    )


def test_models_that_are_not_on_the_ladder_are_not_shown(tmp_path):
    sample.write(tmp_path)
    path = tmp_path / "ladder.json"
    ladder = read_json(path)
    others = [{"model": "base+tilt", "why": "not on the way to this model"}]
    keep_json(path, {**ladder, "rungs": ladder["rungs"][:1], "others": others})
    assert [model.name for model in read_inputs(tmp_path).models] == ["base"]


def test_what_ended_at_its_bound_is_told(first):
    assert first.count("<br><small>at its upper bound</small>") == 1
    assert first.count("<br><small>slope at its lower bound</small>") == 1


def test_a_force_that_is_far_off_is_said_beside_the_pictures(tmp_path):
    """In the sentence of the comparison; of a model without one nothing is said."""
    sample.write(tmp_path / "study")
    file, said = tmp_path / "study/base/compare.npz", "force_x of step 3 is 24 standard deviations off: 3 N measured"
    write_npz(file, {**read_npz(file), "far_off": np.array(said)})
    write_page(tmp_path / "study", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert text.count(f"<p>{said.capitalize()[:1]}{said[1:]}.") == text.count("standard deviations off") == 1


def test_effects_that_config_yaml_leaves_out_are_told():
    """Of many the first ones: that no known effect explains the data is not said then."""

    def said(**diagnosis):
        found = {"verdict": "unexplained", "sentence": "unexplained", **diagnosis}
        model = Model("base", {"verdict": "unexplained", "error": {"fitted": 2.0}}, None, found, {})
        return headline(Inputs("study", {}, [model], []))

    whole, part = said(), said(left_out=list("abcdefgh"))
    assert whole["found"].endswith("and no known effect does.")
    assert "Not tried" not in whole["next"]
    assert part["found"].endswith("and no effect that was tried does.")
    assert part["next"].endswith("Not tried, as diagnosis in config.yaml says: a, b, c, d, e and 3 more.")


def test_effects_that_cannot_be_told_from_those_of_an_adequate_model_are_told_above_its_constants():
    """Not those that were added as well."""
    named = {"ranking": [{"effect": n, "title": f"effect {n}"} for n in "abc"], "effects": list("abc")}

    def said(*effects):
        rungs = [{"verdict": "indistinguishable", "error": {"fitted": 2.0}, "effects": []}]
        rungs += [{"verdict": "adequate", "error": {"fitted": 1.0}, "effects": list(effects)}]
        models = [Model("m", rung, None, found, {}) for rung, found in zip(rungs, (named, {}), strict=True)]
        return headline(Inputs("study", {}, models, []))["next"]

    assert "These measurements cannot tell effect a from effect b or effect c: the intervals reach" in said("a")
    assert "These measurements cannot tell effect a and effect c from effect b:" in said("a", "c")
    assert "cannot tell" not in said("d")
    assert "cannot tell" not in said("a", "b", "c")


def test_a_model_with_as_many_constants_as_measured_values_is_said_to_be_untested(tmp_path):
    """It fits whatever was measured: no word of a failure, no list of candidates that are all 0."""
    sample.write(tmp_path / "study", done=False)
    file, said = tmp_path / "study/base/diagnosis.json", {"verdict": "unexplained", "misfit": 0.0, "freedom": 0}
    told = "there are as many constants as measured values: missing effects cannot be tested"
    keep_json(file, read_json(file) | said | {"effects": [], "families": [], "sentence": told})
    ladder = read_json(tmp_path / "study/ladder.json")
    ladder["rungs"][0] |= said
    keep_json(tmp_path / "study/ladder.json", ladder)
    write_page(tmp_path / "study", tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    shown = text.partition('<section id="provenance">')[0]
    assert "has as many constants as there are measured values: it cannot be tested." in shown
    assert "Not tested: there are as many constants as measured values" in shown
    assert "which these measurements cannot test" in shown and "and it is not" not in shown
    for word in ("does not explain", "no known effect", "describe an effect", "The residual is"):
        assert word not in shown
    assert "Candidates, " not in shown and 'data-panel="pattern"' not in shown


def test_the_noise_of_a_single_step_is_a_band_that_can_be_seen():
    one = Compare(step=np.array([1]), response=np.array([0.01]), response_noise=np.array([0.1]))
    (band,) = curve_panel(one, one.response, 0.3).axes[0].collections
    low, high = band.get_paths()[0].vertices.min(axis=0), band.get_paths()[0].vertices.max(axis=0)
    assert low[0] < 1 < high[0] and low[1] == pytest.approx(-0.2) and high[1] == pytest.approx(0.2)


def test_residual_by_step_has_its_own_scale_whatever_an_effect_would_leave(monkeypatch):
    """Beside a pattern both share one, and nothing else."""
    compare = Compare(
        step=np.arange(1, 4), response=np.array([0.1, -0.05, 0.02]), response_noise=np.full(3, 0.1),
        control=np.array("displacement"),
    )  # fmt: skip
    patterns = {"onset": ("response", np.full(3, 0.1)), "swelling": ("response", np.full(3, 5.0))}
    limits = []
    monkeypatch.setattr(
        panels, "curve_panel", lambda _, values, limit: limits.append(round(limit, 3)) or f"{values} {limit}"
    )
    Panels([Model("base", {}, compare, {}, patterns)])
    assert limits == [0.23, 0.23, 0.23, 5.75, 5.75]
