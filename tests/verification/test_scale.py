"""Nothing knows how large bodies are: one five times as large, and one in other units, get the same answers."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
import yaml
from small_body import SMALL, compared, fitted, written

from fingerfit.diagnosis.candidates import candidates
from fingerfit.diagnosis.ranking import best_places, rank_candidates, stiffness_map
from fingerfit.fit.minimum import finest
from fingerfit.imaging.pictures import read_picture, write_picture

pytestmark = pytest.mark.slow

LARGER, SLOWER = 5.0, 3.0
"""Factors on lengths and on times; stresses stay, so that forces grow with the square of lengths."""
FORCE = LARGER**2
LENGTHS = {
    "onset.offset": LARGER, "soft_frame.most": LARGER, "preshear.aside": LARGER,
    **{f"{name}.{axis}": LARGER for name in ("misregistration", "wandering_pictures") for axis in "xy"},
    **{f"jumping_pictures.{axis}{k}": LARGER for axis in "xy" for k in range(1, 13)},
    **{f"observation_probe.{name}": LARGER for name in ("aside", "upwards", "growing_x", "growing_y")},
    **{f"loading_probe.{name}": LARGER for name in ("reading", "growing")},
    **dict.fromkeys(("sideways.moved", "sideways.early", "indenter_probe.moved", "indenter_probe.midway"), LARGER),
    **{f"interface.{name}": LARGER for name in ("down", "incline", "bend", "third", "fourth", "fifth", "sixth")},
    **{f"geometry_probe.{name}": LARGER for name in ("upper", "lower")},
    **{f"geometry_probe.{form}_{border}": LARGER for form in ("incline", "bend", "third") for border in ("upper", "lower")},
}  # fmt: skip
SIZES = {
    **LENGTHS,
    "preload.force": FORCE, "force_offset.offset": FORCE, "force_drift.drift": FORCE, "guide_friction.most": FORCE,
    "loading_probe.load": FORCE, "loading_probe.midway": FORCE,
    "indenter_probe.curve": 1 / LARGER, "indenter_probe.lowered": LARGER, "curved_indenter.crown": LARGER,
}  # fmt: skip
"""Factors on numbers of effects; those that are not here have none."""
PLACES = {
    "skin.thickness": LARGER, "side_skin.thickness": LARGER, "relaxation.time": SLOWER, "ellipse.radius": LARGER, "wall.gap": LARGER,
    "band.above": LARGER, "band.wide": LARGER,
}  # fmt: skip


SINGLE = 2.0**-24
"""Rounding of the pixels' spacing, which NIfTI-1 keeps in single precision."""
APART = 3e-5
"""How far that moves the residual, in standard deviations of its noise: ten times what was measured, 3e-6 at most."""


def described(folder, length, force, time, picture, units=None):
    """A study whose lengths, forces and times are multiplied, and those of its pictures by another factor."""

    def times(factor, values):
        return {key: value * factor if isinstance(value, (int, float)) else value for key, value in values.items()}

    def scale(source):
        study = yaml.safe_load((source / "study.yaml").read_text(encoding="utf-8"))
        body, noise = times(length, study["body"]), study["noise"]
        body["layers"] = [times(length, layer) for layer in body["layers"]]
        body["origin"] = [length * x for x in body["origin"]]
        study["noise"] = {**noise, "force": noise["force"] * force, "displacement": noise["displacement"] * length}
        study |= {"body": body, "units": units or study["units"]}
        (folder / "pictures").mkdir(parents=True)
        (folder / "study.yaml").write_text(yaml.safe_dump(study))
        with (source / "steps.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        by = {"displacement": length, "force": force, "time": time}
        for row in rows:
            row |= {key: repr(float(row[key]) * factor) for key, factor in by.items()}
        with (folder / "steps.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(rows)
        for path in (source / "pictures").iterdir():
            one = read_picture(path)
            larger = replace(one, spacing=picture * one.spacing, origin=picture * one.origin)
            write_picture(folder / "pictures" / path.name, larger)
        return folder

    return scale


def examined(study, folder):
    """The study fitted, and all candidates tested: the problem, the last round, the candidates, comparison, ranking."""
    problem, last, run, everything = fitted(study, folder, SMALL)
    found = candidates(problem, finest(problem, last).values)[0]
    comparison, more = compared(problem, last, everything, found)
    return problem, last, found, comparison, rank_candidates(comparison, comparison.score_test, found), run + more


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A study of a body of 12 mm with an inclusion."""
    folder = tmp_path_factory.mktemp("small")
    written(folder)
    return folder


@pytest.fixture(scope="module")
def small(source):
    return examined(source / "study", source / "model")


@pytest.fixture(scope="module")
def large(source):
    study = described(source / "large", LARGER, FORCE, SLOWER, LARGER)(source / "study")
    return examined(study, source / "large-model")


def factor(keyword, row, column):
    """By how much a number of a deck of the larger body is larger."""
    return {
        ("CLOAD", 2): FORCE, ("BOUNDARY", 3): LARGER, ("SOLID SECTION", 0): LARGER, ("VISCOELASTIC", 2): SLOWER,
        ("SPRING", 0): LARGER if row == 1 else 1.0,  # area over compliance; the line above is the direction
        **{("NONLINEAR", n): (FORCE, LARGER)[n] if row else 1.0 for n in (0, 1)},  # force and displacement below it
        **{("VISCO", n): SLOWER for n in range(4)},
        ("SURFACE BEHAVIOR", 0): 1 / LARGER, **{(kind, n): LARGER for kind in ("NODE", "SURFACE") for n in (1, 2)},
    }.get((keyword, column), 1.0)  # fmt: skip


def numbers(deck):
    """Numbers of a deck by keyword, row beneath it, and column; its words."""
    keyword, row, found, words = "", 0, {}, []
    for n, line in enumerate(deck.splitlines()):
        if line.startswith("*"):
            keyword, row = line.split(",")[-1 if line.endswith("NONLINEAR") else 0].strip("* "), 0
            words.append(keyword if keyword == "INCLUDE" else line)
            continue
        for column, text in enumerate(line.split(",")):
            try:
                found[n, keyword, row, column] = float(text)
            except ValueError:
                words.append(text)
        row += 1
    return found, words


def test_decks_are_the_same_up_to_scale(small, large):
    names = set()
    for one, other in zip(small[2], large[2], strict=True):
        assert other.effect.name == one.effect.name
        assert other.place == pytest.approx(
            {key: PLACES.get(key, 1.0) * value for key, value in one.place.items()}, rel=1e-5
        )
        for first, second in zip(one.asked, other.asked, strict=True):
            # both at one guess: the fits need not end at one point to the last digit
            values = {**finest(small[0], small[1]).values, **{k: v for k, v in second.values.items() if "." in k}}
            (a, text), (b, words) = numbers(first.deck), numbers(large[0].ask(values).deck)
            assert words == text
            assert a.keys() == b.keys()
            # shares have six digits
            wrong = [key for key in a if b[key] != pytest.approx(factor(*key[1:]) * a[key], rel=1e-5, abs=1e-300)]
            assert wrong == [], one.effect.name
            names.add(one.effect.name)
    assert len(names) > 12


def test_the_same_constants_falls_and_sizes(small, large):
    first, second = (finest(*one[:2]).values for one in (small, large))
    # slopes of the score vanish there: pixels that are 6e-8 off move it by as little
    assert second == pytest.approx(first, rel=10 * SINGLE)
    assert large[3].score_test.freedom == small[3].score_test.freedom
    names = [one.candidate.effect.name for one in best_places(small[4])]
    assert [one.candidate.effect.name for one in best_places(large[4])] == names
    assert large[3].score_test.misfit == pytest.approx(small[3].score_test.misfit, rel=1e-6)
    for one, other in zip(small[4], large[4], strict=True):
        effect, fall = one.candidate.effect, one.finding.fall
        assert other.finding.fall == pytest.approx(fall, rel=0, abs=2 * np.sqrt(fall) * APART + APART**2), effect.name
        scales = np.array([SIZES.get(effect.key(p.name), 1.0) for p in effect.parameters])
        scale = np.array([p.scale for p in effect.parameters])
        # what moves the residual moves the size by as much as the weakest pattern of the numbers is seen badly
        weakest = np.linalg.svd(small[3].score_test.signature(one.columns * scale), compute_uv=False)[-1]
        wanted, spread = one.finding.size / scale, APART / max(weakest, 1e-12)
        spread += APART * np.abs(wanted).max()
        assert other.finding.size / scales / scale == pytest.approx(wanted, rel=0, abs=spread), effect.name
    maps = [stiffness_map(one[3], one[4]) for one in (small, large)]
    assert len(maps[0]) == 30
    assert maps[1][:, :2] == pytest.approx(LARGER * maps[0][:, :2], rel=1e-12)
    assert maps[1][:, 3] == pytest.approx(maps[0][:, 3], rel=0, abs=APART)


def test_in_other_units_nothing_is_new(source, small):
    """Micrometres, millinewtons and milliseconds: the same simulations, to the last digit of their decks."""
    units = {"length": "um", "force": "mN", "time": "ms"}
    study = described(source / "micrometres", 1e3, 1e3, 1e3, 1.0, units)(source / "study")
    *_, ranking, run = examined(study, source / "model")
    assert run == 0
    assert [one.finding.fall for one in ranking] == pytest.approx([one.finding.fall for one in small[4]], rel=1e-9)
