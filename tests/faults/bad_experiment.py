"""experiment.yaml: every key."""

from battery import GONE, INF, NAN, bad, either, holds, put, values

AREA = "experiment.yaml"
FILE = "experiment.yaml"
COMMAND = ("experiment", "experiment.yaml", "--out", "made")


def of(key, *found, **more):
    return values(FILE, key, *found, command=COMMAND, **more)


BRICK = {
    "brick": [8, 7, 6],
    "layers": [{"name": "body", "height": 6, "mu": 0.03, "intensity": 0.5}],
}
GRID = {"pixels": [10, 9, 8], "spacing": [1, 1, 1], "texture": 0.1, "correlation": 2.0, "noise": 0.01, "pictured": [1]}


def space(key, *found, **more):
    """The same for a brick in volumes."""

    def change(place, value):
        for name, part in (("body", BRICK), ("picture", GRID), ("mesh.element", "C3D8")):
            put(FILE, name, part)(place)
        put(FILE, key, value)(place)

    make, says = more.get("make", bad), more.get("says", ("experiment.yaml", key))
    return [
        make(
            f"in space, {key}: {value!r}"[:70], lambda place, value=value: change(place, value), *says, command=COMMAND
        )
        for value in found
    ]


CASES = [
    *of("title", GONE, 3, "", "a\nb"),
    *of("titel", "t"),
    *of("body", GONE, 3, []),
    *of("body.width", GONE, 0, -12, NAN, "12 mm"),
    *of("body.width", 1e308, says=["experiment.yaml", "width|body|mesh"]),
    *of("body.thickness", GONE, 0, INF),
    *of("body.layers", GONE, [], 3, ["top"]),
    *of("body.layers.0.name", GONE, 3, "bottom", "a b", says=["experiment.yaml", "layers", "name"]),
    *of("body.layers.0.height", GONE, 0, -6, NAN, "6 mm"),
    *of("body.layers.0.mu", GONE, 0, -0.03, NAN, "soft"),
    *of("body.layers.0.mu", 1e308, says=["experiment|mu"]),
    *of("body.layers.0.intensity", GONE, 0, -0.5, NAN, "bright"),
    *of("body.layers.0.intensity", 1e308),
    *of("body.layers.0.colour", "red"),
    *of("body.origin", [0, 0]),
    *of("material", GONE, 3, []),
    *of("material.alpha", GONE, 0, NAN, "x", [1.4]),
    *of("material.poisson", GONE, 0.5, 0.6, -1, NAN, "x"),
    *of("material.mu", 0.1),
    *of("mesh", GONE, 3, "fine"),
    *of("mesh.element", GONE, "CPE5", 4, "C3D8"),
    *of("mesh.across", GONE, 0, -3, 2.5, "x", NAN, 10**6),
    *of("mesh.per_layer", GONE, 0, None),
    *of("mesh.grading", GONE, 0.5, NAN, INF, "x"),
    *of("mesh.acros", 3),
    *of("solver", GONE, 3, "calculx", ""),
    *of("displacement", GONE, [], 3, "0.3", ["a"], [NAN, 0.6], [-0.3, 0.6], [0.3, None], [[0.3]], [True, 0.6]),
    *of("displacement", [0.3, 13], [1e308, 1], says=["displacement"]),  # of a body of 12 mm
    *of("displacement", [0.6, 0.3], make=either),
    *of("picture", GONE, 3, []),
    *of("picture.pixels", GONE, 0, -24, 2.5, "x", NAN, 10**6),
    *of("picture.side", GONE, 0, -22, NAN, "x"),
    *of("picture.texture", GONE, -1, NAN, "x"),
    *of("picture.correlation", GONE, 0, -2, NAN, "x", 1e308),
    *of("picture.noise", GONE, -0.01, NAN, "x", 1e308),
    *of("picture.pictured", GONE, [3], [0], 1, ["x"], [1, 1], [1.5], [-1]),
    *of("picture.colour", "red"),
    *of("noise", GONE, 3),
    *of("noise.force", GONE, -0.1, NAN, "x", 1e308),
    *of("noise.displacement", GONE, -0.1, "x"),
    *of("seed", GONE, -1, 1.5, NAN, "x"),
    *of("seed", 2**80, make=either),
    *of("time", 3, [1], [1, "x"], [2, 1], [NAN, 1]),
    *of("effects", 3, ["tilt"], {"tillt": {"slope": 0.01}}, {"tilt": 3}),
    *of("effects.tilt", {"slop": 0.1}, {"slope": "x"}, {"slope": NAN}, {"slope": 99}),
    *of("effects.misregistration", 3),
    *of("own", "nowhere", 3, [], says=["experiment.yaml", "own"]),
    *of("template", "none.inp.j2", 3, "../config.yaml", says=["template|none.inp.j2|config.yaml"]),
    *of("boundary", 3, {"bse": "held"}),
    *of("boundary.base", "hold", 3, says=["boundary|base_"]),
    *of("study", 3, {"bdy": {}}),
    *space("body.brick", [8, 7], [8, 7, 5], [0, 7, 6], "x", [NAN, 7, 6]),
    *space("picture.pixels", [10, 9], [1, 9, 8], [10.5, 9, 8], 10, [10**5, 10**5, 10**5]),
    *space("picture.spacing", [1, 1], [0, 1, 1], "x"),
    *space("picture.samples", 0, 1.5, 513, "x"),
    *space("picture.origin", [0, 0], "x"),
    *space("body.drawn", 3, [3], [{"shape": "cone"}], [{"shape": "box", "low": [0, 0, 0], "high": [1, 1, 1]}]),
    *space("body.drawn", [{"shape": "capsule", "from": [0, 0, 0], "to": [1, 1, 1], "radius": 0, "intensity": 1}]),
    *space("body.tissues", 3, {"BONE": "x"}),
    *space("body.mesh", "none.inp", says=["mesh"]),
    bad("a study is none", holds("experiment.yaml", (b"title: t\nunits: {length: mm}\n")), "experiment.yaml", "units", command=COMMAND, lines=25),
]  # fmt: skip
