"""Results know their study, and nothing damaged is taken for a result."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from blocks import STEPS, STUDY

from fingerfit.core.contents import Contents
from fingerfit.core.errors import InputError, StateError
from fingerfit.core.files import keep_json, keep_text, read_json, read_npz, write_json, write_npz, write_text
from fingerfit.fit.rounds import check_deck, simulation_name
from fingerfit.provenance.results import claim, in_order, mend, model_folder, refuse, study_folder
from fingerfit.provenance.runs import shown
from fingerfit.provenance.stages import write_settings
from fingerfit.settings.config import load_settings
from fingerfit.solvers.registry import get_solver

ROOT = Path(__file__).resolve().parents[2]
CONFIG = yaml.safe_load((ROOT / "config.yaml").read_text(encoding="utf-8"))


def settings(study="subject1/test", results="results", name="base"):
    return load_settings({**CONFIG, "study": study, "results": results, "model": {**CONFIG["model"], "name": name}})


@pytest.fixture
def place(tmp_path, monkeypatch):
    place = tmp_path / "work"
    for name in ("subject1/test", "subject2/test", "studies/phantom", "../outside/test"):
        (place / name).mkdir(parents=True)
    monkeypatch.chdir(place)
    return place


def test_studies_of_the_same_name_have_results_of_their_own(place):
    found = [str(study_folder(settings(name))) for name in ("subject1/test", "subject2/test", "studies/phantom")]
    assert found == ["results/subject1/test", "results/subject2/test", "results/phantom"]
    assert study_folder(settings(str(place / "subject1/test"))) == Path("results/subject1/test")
    assert study_folder(settings("../outside/test")) == Path("results/test")


def test_a_folder_of_another_study_is_refused(place):
    (place / "test").mkdir()
    for first, second in (("../outside/test", "test"), ("subject1/test", "subject1"), ("subject1", "subject1/test")):
        shutil.rmtree(place / "results", ignore_errors=True)
        refuse(settings(first))
        claim(settings(first))
        refuse(settings(first))
        with pytest.raises(
            InputError, match=r"config.yaml: results: found .*, but results/\S+ has results of "
        ) as told:
            refuse(settings(second))
        assert "expected another folder, as results-" in str(told.value)
        assert "\n" not in str(told.value)


def test_a_copied_workspace_keeps_its_results(place, tmp_path, monkeypatch):
    claim(settings())
    shutil.copytree(place, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    refuse(settings())


def test_two_workspaces_do_not_share_a_folder_unknowingly(place, tmp_path, monkeypatch):
    shared = str(tmp_path / "scratch")
    refuse(settings(results=shared))
    claim(settings(results=shared))
    refuse(settings(results=shared))
    shutil.copytree(place, tmp_path / "copy")
    monkeypatch.chdir(tmp_path / "copy")
    with pytest.raises(InputError, match="has results of"):
        refuse(settings(results=shared))


def test_snakemake_discover_may_begin_in_a_folder_outside(place, tmp_path):
    """Snakemake makes the folder of the log before anything runs."""
    shared = tmp_path / "scratch"
    write_text(shared / "test/discover.log", "")
    refuse(settings(results=str(shared)))
    write_text(shared / "test/thesis.txt", "")
    with pytest.raises(InputError, match="outside of this workspace, with test in it"):
        refuse(settings(results=str(shared)))


@pytest.mark.parametrize(
    ("results", "found"),
    [
        ("/etc", "outside of this workspace, with "),
        ("subject1/test", "is the folder of the study"),
        ("subject1", "holds the folder of the study"),
        (".", "holds the folder of the study"),
        ("subject1/test/results", "lies in the folder of the study"),
        (str(ROOT / "templates"), "is the folder of templates"),
        (str(ROOT / "fingerfit/fem"), "lies in the folder of fingerfit"),
        ("file", "which is a file"),
    ],
)
def test_folders_that_are_no_place_for_results(place, results, found):
    write_text(place / "file", "")
    with pytest.raises(InputError) as told:
        refuse(settings(results=results))
    assert str(told.value).startswith(f"config.yaml: results: found {results}, ")
    assert found in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("name", ["sims", "meshes"])
def test_names_that_something_else_has(place, name):
    with pytest.raises(InputError, match=r"config\.yaml: model\.name: found "):
        refuse(settings(name=name))


@pytest.mark.parametrize("name", ["ladder.json", "report.html", "../x", "study.json", "base+tilt"])
def test_names_of_files_and_of_models_with_effects_are_no_names_of_models(name):
    with pytest.raises(Exception, match=r"config.yaml: model.name: found .*; expected letters, digits and _ - only"):
        settings(name=name)


def test_a_study_above_whose_name_has_spaces_is_refused(place, monkeypatch):
    (place / "my disk/inner").mkdir(parents=True)
    monkeypatch.chdir(place / "my disk/inner")
    found = r"config.yaml: study: found \.\., a folder named 'my disk'; expected a folder named with letters"
    with pytest.raises(InputError, match=found):
        refuse(settings(".."))


def test_a_folder_beside_the_study_is_proposed(place, monkeypatch):
    monkeypatch.chdir(place / "subject1/test")
    with pytest.raises(InputError, match=r"results: found results, which lies in .*; expected .* as \.\./results$"):
        refuse(settings("."))


def test_a_study_that_is_a_file_is_refused(place):
    write_text(place / "study.yaml", "")
    with pytest.raises(InputError, match=r"study: found study\.yaml; expected the folder of a study"):
        refuse(settings("study.yaml"))


DECK = "*INCLUDE, INPUT=../../meshes/m.inp\n"
SOLVER = {"name": "builtin", "version": "1"}
KEPT = (
    "base/settings.json", "base/prepared.npz", "base/mesh.inp", "base/refined.inp", "base/rounds/0.json",
    "base/rounds/12.json", "base/estimate.json", "base/compare.npz", "base/diagnosis.json", "base/diagnosis.npz",
    "base/rung.json", "base/simulations.json", "base/residual.npz", "ladder.json",
)  # fmt: skip
HERE = get_solver("builtin").identity()
SIM = f"sims/{simulation_name(DECK, SOLVER)}"


@pytest.fixture
def folder(place):
    """Results of a study, one file of each kind."""
    folder = study_folder(settings())
    claim(settings())
    for name in KEPT:
        if name.endswith(".npz"):
            write_npz(folder / name, {"a": np.arange(20.0), "word": np.array("some")})
        elif name.endswith("settings.json"):
            write_settings(settings(), folder / name)
        elif name.endswith(".json"):
            asked = {"number": int(Path(name).stem), "solver": HERE} if "rounds" in name else {}
            keep_json(folder / name, {"a": [1.5, None], "b": {"word": "some"}, **asked})
        else:
            keep_text(folder / name, "*NODE\n1, 0, 0\n")
    write_npz(folder / SIM / "solution.npz", {"a": np.arange(20.0)})
    write_text(folder / SIM / "deck.inp", DECK)
    write_json(folder / SIM / "solver.json", {**SOLVER, "includes": []})
    return folder


def mended(remove=True):
    return mend(settings(), Contents(), remove)


@pytest.mark.parametrize("name", [*KEPT, f"{SIM}/solution.npz", f"{SIM}/deck.inp"])
def test_every_flipped_bit_and_every_cut_is_noticed(folder, name):
    path = folder / name
    content = path.read_bytes()
    assert mended() == []
    wrong = [content[:n] + bytes([content[n] ^ 1 << n % 8]) + content[n + 1 :] for n in range(len(content))]
    wrong += [content[:n] for n in range(len(content))]
    # every 7th, so that all bits and all parts of a file have their turn
    for damage in wrong[::7]:
        path.write_bytes(damage)
        assert mended(remove=False) == [f"{path}: is damaged; it will be removed and made again"]
    assert mended() == [f"{path}: is damaged; removed and made again"]
    assert not path.exists()
    assert mended() == []


def test_rounds_that_asked_another_version_of_the_solver_are_made_again(folder):
    """As those of results that were copied without what Snakemake knows of them, once fingerfit is a newer one."""
    rounds = [folder / f"base/rounds/{number}.json" for number in (0, 12)]
    keep_json(rounds[1], {"number": 12, "solver": {**HERE, "fingerprint": "an older one"}})
    assert mended() == [f"{rounds[1].parent}: asked another solver or version; removed and made again"]
    assert rounds[0].exists()
    assert not rounds[1].exists()
    assert mended() == []


@pytest.mark.parametrize("key", ["law", "per_test"])
def test_settings_of_another_version_are_made_again(folder, key):
    path = folder / "base/settings.json"
    data = read_json(path)
    data["model"]["older"] = data["model"].pop(key)
    keep_json(path, {name: part for name, part in data.items() if name != "checksum"})
    assert mended(remove=False) == [f"{path}: of another version; it will be removed and made again"]
    assert mended() == [f"{path}: of another version; removed and made again"]
    assert not path.exists()
    assert mended() == []


@pytest.mark.parametrize("name", ["base/estimate.json", "base/prepared.npz", "base/none.json", "base/none.npz"])
def test_a_reader_takes_nothing_damaged(folder, name):
    path = folder / name
    if path.exists():
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    with pytest.raises(StateError, match=rf"{name}: cannot be read: .*; run snakemake") as told:
        (read_json if name.endswith("json") else read_npz)(path)
    assert "\n" not in str(told.value)


def test_a_deck_or_mesh_of_another_name_is_not_solved(folder):
    deck = folder / SIM / "deck.inp"
    check_deck(deck, {**SOLVER, "includes": ["m.inp"]})
    write_text(folder / "meshes/m.inp", "*NODE\n")
    with pytest.raises(StateError, match=r"meshes/m.inp: cannot be read: damaged"):
        check_deck(deck, {**SOLVER, "includes": ["m.inp"]})
    write_text(deck, DECK + "** more\n")
    with pytest.raises(StateError, match=r"deck.inp: cannot be read: damaged"):
        check_deck(deck, {**SOLVER, "includes": []})


def test_a_file_that_a_template_includes_by_its_path_names_the_simulation(tmp_path):
    inner = tmp_path / "law.inp"
    deck = f"*INCLUDE, INPUT={inner}\n"
    names = set()
    for text in ("*MATERIAL, NAME=A\n", "*MATERIAL, NAME=B\n"):
        write_text(inner, text)
        names.add(simulation_name(deck, SOLVER))
    assert len(names) == 2


def test_what_is_damaged_in_the_cache_of_snakemake_goes_with_the_link(folder, tmp_path):
    path = folder / SIM / "solution.npz"
    shutil.move(path, tmp_path / "cached")
    (tmp_path / "cached").write_bytes(b"PK")
    path.symlink_to(tmp_path / "cached")
    assert len(mended()) == 1
    assert not path.is_symlink()
    assert not (tmp_path / "cached").exists()


def test_times_of_results_follow_their_order(folder):
    import os

    model = model_folder(settings())
    names = ("prepared.npz", "rounds/0.json", "rounds/12.json", "estimate.json", "diagnosis.json")
    for time, name in enumerate(reversed(names), 1):  # the last is the oldest
        os.utime(model / name, (time, time))
    in_order(settings())
    times = [(model / name).stat().st_mtime_ns for name in names]
    assert times == sorted(times)
    in_order(settings())
    assert times == [(model / name).stat().st_mtime_ns for name in names]


def test_the_figures_that_there_are_stand_beside_the_table(tmp_path):
    """A fit to points or forces has none of pictures."""
    run = SimpleNamespace(folder=str(tmp_path / "base"), study=str(tmp_path))
    write_text(tmp_path / "base/table.txt", "a table\n")
    assert shown([run]) == ["a table\n", f"table: {tmp_path}/base/table.txt"]
    for name in ("search", "force"):
        write_text(tmp_path / f"base/figures/{name}.png", "a figure\n")
    assert shown([run])[1:] == [f"table: {tmp_path}/base/table.txt; figures: {tmp_path}/base/figures (force, search)"]


def test_results_made_with_other_effects_are_made_again(folder, place):
    """As those of results that were copied without what Snakemake knows of them, once the catalogue is another one."""
    write_text(place / settings().study / "study.yaml", yaml.safe_dump(STUDY))
    write_text(place / settings().study / "steps.csv", STEPS)
    (place / settings().study / "effects").mkdir()
    own = place / settings().study / "effects/mine.yaml"
    effect = {
        "title": "t",
        "acts": "structure",
        "words": "w",
        "look": "l",
        "confirm": "c",
        "changes": {"field": "size"},
    }
    number = {"unit": "1", "absent": 0, "lower": -2, "upper": 2, "step": 0.2}
    path = folder / "base/settings.json"
    write_text(own, json.dumps({**effect, "parameters": {"size": number}}))
    write_settings(settings(), path, with_study=True)
    assert mended() == []
    write_text(own, json.dumps({**effect, "parameters": {"size": {**number, "upper": 1}}}))
    line = f"{path}: knows other effects than there are now; it and what follows from it:"
    assert mended(remove=False) == [f"{line} it will be removed and made again"]
    assert path.exists()
    assert mended() == [f"{line} removed and made again"]
    left = {str(one.relative_to(folder)) for one in folder.rglob("*") if one.is_file()}
    assert left >= {"base/prepared.npz", "base/mesh.inp", "base/refined.inp", f"{SIM}/solution.npz", "ladder.json"}
    made = {"settings", "rounds", "estimate", "compare", "diagnosis", "rung", "simulations"}
    assert not {name for name in left if name.startswith("base/") and name.split("/")[1].partition(".")[0] in made}
    assert mended() == []
