"""study.yaml: every key."""

from battery import GONE, INF, NAN, bad, fine, put, values

AREA = "study.yaml"
FILE = "study/study.yaml"


def of(key, *found, **more):
    return values(FILE, key, *found, **more)


CASES = [
    *of("title", 3, ["t"], "two\nlines", ""),
    *of("title", GONE, None, make=fine),
    *of("tittle", "t"),
    *of("units", GONE, None, [], "mm", 3),
    *of("units.length", GONE, "inch", "MM", "", 3, ["mm"]),
    *of("units.length", "m", says=["picture", "mesh"]),  # the body is larger than the pictures then
    *of("units.length", "um", says=["before.mha", "units.length"]),  # and in no two pixels
    *of("units.force", GONE, "lbf", "n", 9.81),
    *of("units.time", GONE, "hours", {"s": 1}),
    *of("units.mass", "kg"),
    *of("control", GONE, None, "", "froce", "Force", 3, ["force"], {"force": 1}, True),
    *of("steps", GONE, None, "", 3, ["steps.csv"]),
    *of("steps", "none.csv", ".", says=["none.csv|study"]),
    *of("pictures", 3, [], "before.mha"),
    *of("pictures.before", GONE, None, "", 3, ["before.mha"], "none.mha", "two\nlines"),
    *of("pictures.noise", -1, 0, "estimatd", NAN, INF, [], ["none.mha"], [3], True, {"sd": 1}),
    *of("pictures.noise", 1e308, ["."], says=["noise|study"]),
    *of("pictures.trim", "bdoy", 3, [[0, 0]], [[0, 0], [9]], [[9, 9], [1, 1]], [[NAN, 0], [9, 9]], [[INF, 0], [9, 9]]),
    *of("pictures.trim", [[900, 900], [901, 901]], [[0, 0, 0], [9, 9, 9]], [[-1e308, 0], [1e308, 9]]),
    *of("pictures.resize", "on", 16, [16], [1, 1], [0, 16], [-16, 16], [16.5, 16], ["16", 16], [100000, 100000]),
    *of("pictures.resize", [16, 16, 16]),
    *of("pictures.gaussian", -1, 21, "wide", NAN, INF, True, [1]),
    *of("pictures.scale", "ragne", 3, True),
    *of("pictures.scale", "off"),
    *of("pictures.befor", "before.mha"),
    *of("noise", 3, [], "0.1"),
    *of("noise.force", -1, 0, "estimatd", NAN, INF, [0.1], "0.1 N", True),
    *of("noise.force", "estimated", says=[r"noise\.force: found estimated, from 2 steps"]),
    *of("noise.displacement", -1, 0, "0.01 mm", NAN, 1e400),
    *of("noise.points", -1, "some"),
    *of("noise.force_gain", -0.1, 0.02, "1 %", NAN),
    *of("noise.frame", -1, NAN, "x"),
    *of("noise.froce", 0.1),
    *of("body", GONE, None, 3, [], "block"),
    *of("body.width", GONE, None, -12, 0, "12 mm", "12", [12], NAN, INF, True),
    *of("body.width", 10**400, says=["study.yaml"]),
    *of("body.width", 1e308, 1e-308, says=["body|width|mesh"]),
    *of("body.width", 1200, says=["picture", "mesh"]),
    *of("body.thickness", GONE, 0, -70, "thick", NAN, INF),
    *of("body.thickness", 1e308, 1e-308, says=["thickness"]),
    *of("body.origin", [0], [0, 0, 0], "0, 0", [NAN, 0], [INF, 0], [True, 0]),
    *of("body.origin", [1e308, 0], [500, 0], says=["picture|origin"]),
    *of("body.layers", GONE, None, [], {}, 3, ["top"]),
    *of("body.layers.0", None, [], "top"),
    *of("body.layers.0.name", GONE, "", 3, "a b", "bottom", "../top", "a\nb", "BOTTOM", says=["layers", "name"]),
    *of("body.layers.0.height", GONE, 0, -6, "6 mm", NAN, INF, [6]),
    *of("body.layers.0.height", 1e308, 1e-308, says=["layers|height|mesh"]),
    *of("body.layers.0.hieght", 6),
    *of("body.layers.1.colour", "red"),
    *of("body.brick", [12, 12, 12], says=["width and brick"]),
    *of("body.mesh", "none.inp", 3, ["m.inp"], says=["body", "mesh"]),
    *of("body.refined", "fine.inp"),
    *of("body.widht", 12),
    *of("boundary", GONE, 3, [], "held"),
    *of("boundary.base", GONE, "hold", 3, ["held"], {"kind": "hold"}, {"nodes": "BOTTOM"}, {"kind": "held", "nodes": 3}),
    *of("boundary.base", {"kind": "held", "nodes": "NOWHERE"}),  # which a block does not have
    *of("boundary.indenter", GONE, "glue", None, {"kind": "glued", "node": "TOP"}, {"kind": "glued", "nodes": ""}),
    *of("boundary.indentor", "glued"),
    *of("body.brick", [8, 7], [8, 7, 0], [8, 7, -6], [8, 7, NAN], "8, 7, 6", 6, place="volume"),
    *of("body.brick", [8, 7, 1e308], [8e5, 7e5, 6e5], says=["brick|picture|mesh"], place="volume"),
    *of("body.layers.0.height", 5, says=["body.layers", "brick"], place="volume"),
    *of("pictures.trim", [[0, 0], [9, 9]], place="volume"),
    *of("pictures.resize", [16, 14], [9999, 9999, 9999], place="volume"),
    *of("body.mesh", ".", "study.yaml", "before.mha", "steps.csv", says=["study|mesh"], place="meshed"),
    *of("body.thickness", GONE, 0, "unknwon", place="meshed"),
    *of("body.layers.0.elements", "NOWHERE", "", 3, says=["elements|NOWHERE"], place="meshed"),
    *of("body.layers.0.elements", "LOWER", says=["LOWER|elements"], place="meshed"),  # as the other layer
    *of("boundary.base", {"kind": "held", "nodes": "NOWHERE"}, says=["NOWHERE"], place="meshed"),
    *of("boundary.indenter", {"kind": "glued", "nodes": "BOTTOM"}, says=["BOTTOM|indenter"], place="meshed"),
    *of("noise.points", GONE, 0, -1, NAN, place="points"),
    *of("noise.points", "estimated", says=["noise.points: found estimated, from 4 points a step"], place="points"),
    *of("units.force", "kN", "mN"),  # a body of no such modulus
    fine("body.mesh: an empty set of node names", put(FILE, "boundary.base", {"kind": "held", "nodes": "bottom"}), place="meshed"),
    bad("pictures left out, the table names some", put(FILE, "pictures", GONE), "pictures"),
    bad("nothing but a title", lambda place: (place / FILE).write_text("title: t\n"), "study.yaml", "units", lines=5),
]  # fmt: skip
