"""A study on a mesh of its own outlines: data of a finer rectangular mesh; an oblique region is found to be as its layer."""

import yaml
from small_body import DESCRIPTION, config_of, written

from fingerfit.core.files import write_json, write_text
from fingerfit.deck.mesh_file import format_mesh
from fingerfit.fit.estimate import estimate_of
from fingerfit.fit.simulate import begin, run_fit
from fingerfit.segment.outlines import mesh_shapes, shapes_of
from fingerfit.settings.config import load_settings
from fingerfit.study.reader import load_study

OUTLINE = [[5.88, 5.16], [2.68, 2.76], [4.12, 0.84], [7.32, 3.24]]
"""In the lower layer: 4 by 2.4 mm."""
MATERIAL = {"alpha": 1.4, "poisson": 0.45}
"""Quadratic triangles of a Poisson's ratio of 0.49 are 5 % too stiff."""
TRUE = {"mu_top": 0.03, "mu_bottom": 0.06, "mu_patch": 0.06}


def test_constants_of_layers_and_region(tmp_path):
    picture = {**DESCRIPTION["picture"], "pictured": [1, 2]}
    own = {"material": MATERIAL, "displacement": [1.0, 2.0], "time": [10, 20], "picture": picture, "effects": {}}
    mesh = {"element": "CPE8H", "across": 24, "per_layer": 12, "grading": 1}
    study = written(tmp_path, mesh=mesh, **own)
    described = yaml.safe_load((study / "study.yaml").read_text())
    described["body"]["regions"] = [{"name": "patch", "outline": OUTLINE}]
    write_json(study / "study.yaml", described)
    shapes = shapes_of(load_study(study))
    for name, size in (("body.inp", 1.5), ("refined.inp", 0.9)):
        write_text(study / name, format_mesh(mesh_shapes(shapes, size)))
    described["body"] = {
        "mesh": "body.inp",
        "refined": "refined.inp",
        "thickness": 70,
        "layers": [{"name": "top"}, {"name": "bottom"}],
        "regions": [{"name": "patch", "elements": "PATCH"}],
    }
    write_json(study / "study.yaml", described)
    given = config_of(study, {})
    mu = {"unit": "MPa", "start": 0.045, "lower": 0.01, "upper": 0.3}
    given["model"] |= {"material": MATERIAL, "parameters": dict.fromkeys(TRUE, mu)}
    given["fit"] |= {"score": "likelihood", "stages": [{"name": "fit", "kind": "least_squares", "tolx": 1e-3}]}
    given["fit"].pop("steps")
    problem, _ = begin(load_settings(given), tmp_path / "fit")
    last, _ = run_fit(problem, 1)
    found = estimate_of(problem, last, 1)["parameters"]
    print({name: (one["value"], one["standard_error"], one["interval95"]) for name, one in found.items()})
    for name, true in TRUE.items():
        low, high = found[name]["interval95"]
        assert low < true < high
        assert abs(found[name]["value"] / true - 1) < 0.04
        assert high / low < 1.3
