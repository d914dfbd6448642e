"""Studies of one layer: of one step and one picture, and of two tests of forces."""

from seeds import seed_of

DESCRIPTION = {
    "title": "one layer, one step, one picture",
    "body": {
        "width": 12,
        "thickness": 70,
        "layers": [{"name": "gel", "height": 12, "mu": 0.03, "intensity": 0.5}],
    },
    "material": {"alpha": 1.4, "poisson": 0.49},
    "mesh": {"element": "CPE4", "across": 3, "per_layer": 3, "grading": 1},
    "solver": "builtin",
    "displacement": [0.5],
    "picture": {"pixels": 32, "side": 22, "texture": 0.15, "correlation": 0.6, "noise": 0.01, "pictured": [1]},
    "noise": {"force": 0.001, "displacement": 0.01},
    "seed": seed_of(3),
}
MODEL = {
    "material": {"alpha": 1.4, "poisson": 0.49},
    "mesh": {"element": "CPE4", "across": 3, "per_layer": 3},
    "parameters": {"mu": {"unit": "MPa", "start": 0.04, "lower": 0.01, "upper": 0.1}},
}
SHARED = {
    "model": MODEL,
    "fit": {
        "score": "ssd",
        "replicates": 20,
        "max_evaluations": 3,
        "stages": [{"name": "grid", "kind": "grid", "points": 2}],
    },
}
"""What config.yaml says of it beside where it is."""
FEW = ["compressibility", "inclusion", "base_slip", "tilt", "onset", "misregistration", "intensity_drift"]
"""Effects that the diagnosis tries where it does not matter which ones: a tenth of all."""
TWO_TESTS = {
    "units": {"length": "mm", "force": "N", "time": "s"},
    "control": "displacement",
    "steps": "steps.csv",
    "noise": {"force": 0.05},
    "body": {"width": 12, "thickness": 70, "layers": [{"name": "gel", "height": 12}]},
    "boundary": {"base": "held", "indenter": "glued"},
    "tests": {"plate": {}, "greased": {"boundary": {"base": "slides", "indenter": "slides"}}},
}
"""study.yaml of a plate that is glued, and one that is greased."""
