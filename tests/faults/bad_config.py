"""config.yaml: every key, and settings that do not fit the study."""

from battery import GONE, INF, NAN, all_of, bad, either, fine, put, values

AREA = "config.yaml"
FILE = "config.yaml"
LONG = "x" * 300


def of(key, *found, **more):
    return values(FILE, key, *found, **more)


def model(key, *found, **more):
    return of(f"model.{key}", *found, **more)


def mu(key, *found, **more):
    return of(f"model.parameters.mu.{key}", *found, says=["config.yaml", "parameters.mu"], **more)


def fit(key, *found, **more):
    return of(f"fit.{key}", *found, **more)


def stage(key, *found, **more):
    return of(f"fit.stages.0.{key}", *found, **more)


CASES = [
    *of("study", GONE, None, 3, "", "a b", "nowhere", "config.yaml", ["study"], "$(ls)", "a*", LONG),
    *of("results", None, 3, "", "a b", ["results"], "{x}", "config.yaml", LONG),
    *of("solver", None, 3, "", "calculx", ["builtin"], {"name": "builtin"}),
    *of("solver", GONE, make=fine),
    *of("solvr", "builtin"),
    *of("model", GONE, None, 3, [], "block"),
    *model("name", "", "a b", "../up", "/tmp/x", 3, None, LONG),
    *model("template", "none.inp.j2", "../config.yaml", "/etc/passwd", "", 3, ".", says=["config.yaml, model.template|model.template|template"]),
    *model("material", None, 3, [1.4]),
    *model("material.alpha", GONE, 0, NAN, INF, "1.4 MPa", [1.4]),
    *model("material.alpha", True, says=["model.material"]),
    *model("material.alpha", 1e308, -1e308, 1e-308, says=["alpha"]),
    *model("material.poisson", GONE, 0.5, 0.6, -1, NAN, "half"),
    *model("material.mu", 0.1, says=["mu"]),  # which is fitted
    *model("material.mu_top", 0, -0.1, 1e308, says=["mu_top"]),
    *model("material.mu_skin", 0.1),
    *model("material.nu", 0.3),
    *model("mesh", GONE, None, 3, []),
    *model("mesh.element", GONE, "CPE5", "cpe4", 3, "C3D8", "S4"),
    *model("mesh.across", GONE, 0, -3, 2.5, "3x", NAN, 1001, 1e308, True, [3]),
    *model("mesh.per_layer", GONE, 0, 2.5, None, 100000),
    *model("mesh.grading", 0, 0.5, -1, NAN, INF, "x"),
    *model("mesh.grading", 1e308, says=["grading"]),
    *model("mesh.acros", 3),
    *model("refined", 3, "fine"),
    *model("refined.element", GONE, "C3D8", "CPE9"),
    *model("refined.across", GONE, 0, "x"),
    *model("parameters", GONE, None, {}, 3, ["mu"]),
    *model("parameters.mu", None, 3, 0.1, []),
    *mu("unit", GONE, "kPa", 3, "1", ""),
    *mu("start", GONE, 5, 0, -1, NAN, INF, "x", 1e308, True, None),
    *mu("lower", GONE, 0, -1, 2, NAN, "x"),
    *mu("upper", GONE, 0.001, 0.01, INF, NAN, -1, "x"),
    *mu("upper", 1e308, 1e300),  # a span that no search could walk
    *mu("log", "maybe", 3, None, [True]),
    *mu("scale", 1),
    *model("parameters.nu", {"unit": "1", "start": 0.3, "lower": 0.1, "upper": 0.4}),
    *model("parameters.mu_skin", {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1}),
    *model("parameters.mu_", {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1}),
    *model("parameters.alpha", {"unit": "1", "start": 1, "lower": -1, "upper": 2, "log": False}),
    *model("parameters.poisson", {"unit": "1", "start": 0.45, "lower": 0.4, "upper": 0.5}),
    bad("a constant that no layer uses", all_of(
        put(FILE, "model.parameters.mu_top", {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1}),
        put(FILE, "model.parameters.mu_bottom", {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1}),
    ), "model.parameters.mu"),
    *model("effects", 3, ["tilt"], "tilt", None),
    *model("effects", {"tillt": {}}, {3: {}}, {"": {}}),
    *model("effects.tilt", 3, None, [0.1], {"slop": 0.01}, {"slope": 9}, {"slope": NAN}, {"slope": "x"}, {"slope": True}),
    *model("effects.coarse_mesh", {}, says=["coarse_mesh"]),
    *of("fit", GONE, None, 3, []),
    *fit("score", GONE, None, "mi", "NMI", 3, ["nmi"]),
    *fit("steps", [1, 8], [0], [-1], [1.5], ["one"], [True], 1, "1", [], [1, 1], [10**30]),
    *fit("smooth", -1, NAN, INF, "x", True),
    *fit("smooth", 1e308, 1e6, says=["smooth"]),
    *fit("crop", 0.01, -1, NAN, INF, "x"),
    *fit("crop", 1e308, make=either),  # the whole picture
    *fit("bins", 3, 513, 32.5, -1, "x", 1e308),
    *fit("batch", 0, -1, 1.5, "x", True),
    *fit("max_evaluations", 0, -1, 1.5, "x"),
    *fit("replicates", 19, 0, -60, "x", 1e308),
    *fit("seed", -1, 1.5, "x"),
    *fit("stages", GONE, None, [], 3, {}, ["grid"], [3]),
    *fit("stages.1", {"name": "s", "kind": "grid"}, says=["fit.stages", "twice"]),
    *stage("name", GONE, "", "a/b", "a\nb", 3),
    *stage("kind", GONE, "girds", 3),
    *stage("tolx", 0, -1, NAN, INF, "x"),
    *stage("tolf", 0, -1, NAN, "x"),
    *stage("points", 1, 0, 2.5, "x"),
    *stage("step", 0, -1, NAN, INF),
    *stage("step", 1e308),
    *stage("restarts", -1, 1.5),
    *stage("tol", 1e-3),
    *fit("scor", "nmi"),
    # against the study
    *model("mesh", {"element": "CPE4", "across": 3, "per_layer": 2}, place="meshed"),
    *model("refined", {"element": "CPE4", "across": 3, "per_layer": 2}, place="meshed"),
    *model("mesh.element", "CPE4", "CPS8", place="volume"),
    *fit("score", "nmi", "ssd", place="points"),
    *fit("steps", [3], place="points"),
    *model("effects.intensity_drift", {}, says=["effects.intensity_drift"], place="points"),
    *model("effects.wall", {}, says=["effects.wall"], place="volume"),
    *model("effects.friction", {}, says=["effects.friction"]),
    *of("solver", "abaqus", says=["abaqus", "executable"], environment={"FINGERFIT_ABAQUS": "no-such-program job={job}"}),
    *of("solver", "calculix", says=["no-such-ccx"], environment={"FINGERFIT_CCX": "no-such-ccx"}),
    bad("hybrid elements for CalculiX", all_of(put(FILE, "solver", "calculix"), put(FILE, "model.mesh.element", "CPE4H")), "model.mesh.element"),
]  # fmt: skip
