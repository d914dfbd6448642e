"""A study's own effect: every key of its YAML."""

from battery import GONE, INF, NAN, bad, either, fine, holds, put, swap, values
from places import EFFECT

SIZE = EFFECT["parameters"]["size"]
AREA = "effects"
FILE = "study/effects/own.yaml"
PART = "study/effects/own.inp.j2"


def of(key, *found, **more):
    return values(FILE, key, *found, **more)


def own(text):
    """The effect as a part of the deck."""
    return holds(PART, text)


CASES = [
    *of("title", GONE, None, 3, "", "two\nlines"),
    *of("acts", GONE, "strucure", 3, ["structure"]),
    *of("words", GONE, 3),
    *of("look", GONE, []),
    *of("confirm", GONE, ""),
    *of("tittle", "t"),
    *of("parameters", GONE, None, 3, ["size"], {"size": 3}, {"size": None}),
    *of("parameters", {}),  # an effect without a number cannot be found
    *of("parameters.size.unit", GONE, 3, None),
    *of("parameters.size.absent", GONE, "none", NAN, 9, INF),
    *of("parameters.size.lower", GONE, NAN, "x"),
    *of("parameters.size.lower", 2, says=["own.yaml", "parameters.size"]),
    *of("parameters.size.upper", GONE, -2, NAN, True),
    *of("parameters.size.step", GONE, 0, 9, NAN, "x", -3),
    *of("parameters.size.scale", 1),
    *(
        (either if name in ("x", "_", "größe") else bad)(f"a number named {name!r}", put(FILE, "parameters", {**EFFECT["parameters"], name: SIZE}), "own.yaml", "parameters|scan|changes")
        for name in ("exp", "x", "place", "a b", "", 3, "if", "a.b", "_", "größe")
    ),
    *of("scan", 3, [1, 2], "place"),
    *of("scan.place", 3, [], ["here"], [NAN], [None], [True, False], "1, 2", [[1]]),
    *of("scan.place", [-1e308, INF]),
    *of("scan", {"size": [1, 2]}, says=["own.yaml", "size|scan"]),  # the name of its parameter
    *of("scan", {name: list(range(40)) for name in ("place", *"abcdef")}, says=["own.yaml", "scan"]),  # 4e9 places
    *of("refine", 3, {"palce": [1, 2]}),
    *of("refine.place", 3, [1], [1, 2, 3], [NAN, 1], ["a", "b"], [5, 0.5], [1, 1]),
    *of("changes", 3, ["field"], {"filed": "size"}),
    *of("changes.field", None, [], "", {"a": 1}),
    *of("observes", 3, {"forse": "force"}),
    *of("observes.force", None, [], ""),
    *of("needs", "tyme", 3, ["layers", 3], {"time": 1}),
    *of("needs", "time", "layers", ["layers", "pictures"], "space", make=fine),
    *of("control", "froce", 3, ["force"]),
    *of("control", "displacement", make=fine),  # then it makes no sense here
    *of("shares_of", 3, ["size"], {"siez": "height"}),
    *of("shares_of.size", None, [], "", 3, "heigth", "height *", "-height", "1 / 0", "width - width"),
    *of("shares_of.size", "height", "1 / width", "height / width", make=either),  # then its bounds may be too wide
    *of("replaces", "bsae", 3, {"base": 1}, ["base", None]),
    *of("replaces", "base", ["base", "indenter"], make=fine),
    *of("place", "size", ["size"], ["size", "x +"], ["size", "sice"], {"x": 1}, [[1, 2]]),
    *of("place", ["place * width", "height / 2"], make=fine),
    *of("told", 3, ["here"], {"size": "as large"}),
    *of("told.place", 3, [], ""),
    *of("told.place", "at {value.real} {percent} {nothing", make=fine),
    *of("signal", "mehs", 3),
    *of("fault", 3, ""),
    *of("cure", [], ""),
    *of("changes", GONE, make=either),
    *of("observes", GONE, make=fine),
    bad("a part without its effect", holds("study/effects/other.inp.j2", "** nothing\n"), "other.inp.j2"),
    bad("an unknown name in its part", own("{{ effects.own.siez }}\n"), "own.inp.j2"),
    bad("a syntax error in its part", own("{% if %}\n"), "own.inp.j2", "line 1"),
    bad("an unknown keyword in its part", own("*SPRNG\n"), "SPRNG"),
    bad("a part that ends the deck's step", own("*END STEP\n"), "END STEP"),
    fine("a part that is a comment", own("** nothing\n")),
    bad("a name with a blank", lambda place: (place / FILE).rename(place / "study/effects/my own.yaml"), "my own"),
    bad("a name with a dot", lambda place: (place / FILE).rename(place / "study/effects/my.own.yaml"), "my.own"),
    either("a name of the catalogue, with another number than its template has", lambda place: (place / FILE).rename(place / "study/effects/tilt.yaml"), "slope"),
    either("the folder is a file", lambda place: ((place / FILE).unlink(), (place / "study/effects").rmdir(), (place / "study/effects").write_text("")), "effects"),
    bad("a number that is none in the model", put("config.yaml", "model.effects", {"own": {"palce": 1}}), "model.effects.own.palce"),
    bad("a place that is none in the model", put("config.yaml", "model.effects", {"own": {"place": 900}}), "model.effects.own.place"),
    fine("in the model", put("config.yaml", "model.effects", {"own": {"size": 0.1, "place": 1}})),
    bad("a unit that is a number", swap(FILE, "unit: '1'", "unit: 1"), "parameters.size.unit"),
]  # fmt: skip
