"""Decks that a person wrote, and results files that belong to others."""

from battery import NOT_FILES, bad, either, fine, holds, instead, nothing, recoded, swap

AREA = "decks"
FILE = "deck.inp"
SIMULATE = ("simulate", "deck.inp", "--solver", "builtin.json", "--out", "s.npz")
SHOW = ("deck", "show", "deck.inp")


def text(name, old, new, *says, **more):
    return more.pop("make", bad)(
        name, swap(FILE, old, new), *(says or ["deck.inp"]), place="deck", **{"command": SIMULATE} | more
    )


def deck(name, content, *says, **more):
    return bad(name, holds(FILE, content), *(says or ["deck.inp"]), place="deck", **{"command": SHOW} | more)


def card(name, content, *says, **more):
    """A card more, before the first step."""
    return bad(
        name,
        recoded(FILE, lambda data: data.replace(b"*STEP", content.encode() + b"\n*STEP", 1)),
        *(says or ["deck.inp"]),
        place="deck",
        **{"command": SHOW} | more,
    )


CASES = [
    fine("the deck itself", nothing, place="deck", command=SIMULATE),
    fine("shown", nothing, place="deck", command=SHOW),
    *(bad(f"to be solved: {name}", instead(FILE, make), "deck.inp", place="deck", command=SIMULATE) for name, make in NOT_FILES.items()),
    *(bad(f"to be shown: {name}", instead(FILE, make), "deck.inp", place="deck", command=SHOW) for name, make in NOT_FILES.items()),
    *(bad(f"its mesh: {name}", instead("mesh.inp", make), "mesh.inp", place="deck", command=SIMULATE) for name, make in NOT_FILES.items()),
    *(bad(f"the solver: {name}", instead("builtin.json", make), "builtin.json", place="deck", command=SIMULATE) for name, make in NOT_FILES.items()),
    deck("empty", ""),
    deck("text", "hello\n"),
    deck("bytes", bytes(range(256)) * 20),
    deck("a heading only", "*HEADING\nx\n"),
    text("no steps", "*STEP", "** STEP"),
    text("a step that does not end", "*END STEP", "** END STEP"),
    text("no section", "*SOLID SECTION", "** SOLID SECTION"),
    text("a section of a material that is not there", "*MATERIAL, NAME=", "*MATERIAL, NAME=X", "deck.inp", "material"),
    card("an unknown keyword", "*ELEMNT", "deck.inp", "ELEMNT"),
    card("a keyword of other programs", "*PLASTIC\n1, 2", "PLASTIC"),
    card("a boundary without axes", "*BOUNDARY\nTOP", "BOUNDARY"),
    card("a boundary of axis 9", "*BOUNDARY\nTOP, 9, 9", "axis|BOUNDARY", command=SIMULATE),
    card("a boundary of a node that is not there", "*BOUNDARY\n9999, 1", "9999"),
    card("a load before the steps", "*CLOAD\n1, 1, 1.", "CLOAD"),
    card("an equation with too few terms", "*EQUATION\n2\n1, 1, 1.", "EQUATION"),
    card("an equation of itself", "*EQUATION\n2\n5, 1, 1., 5, 1, -1.", "EQUATION", command=SIMULATE),
    card("a node twice, elsewhere", "*NODE\n1, 5., 5.", "NODE|node"),
    card("a spring of a set that is not there", "*SPRING, ELSET=NONE\n1\n3.", "NONE|SPRING"),
    card("a contact of surfaces that are not there", "*SURFACE INTERACTION, NAME=I\n*CONTACT PAIR, INTERACTION=I\nA, B", "CONTACT|A"),
    card("friction alone", "*FRICTION\n0.3", "FRICTION"),
    card("an amplitude that goes back in time", "*AMPLITUDE, NAME=A\n0., 0., 1., 1., 0.5, 0.", "AMPLITUDE"),
    card("a surface of elements that are not there", "*SURFACE, NAME=S\n9999, S1", "9999|SURFACE", command=SIMULATE),
    card("a tie of nothing", "*TIE, NAME=T\nA, B", "TIE|A"),
    card("a rigid body without reference", "*RIGID BODY, ELSET=TOP", "RIGID BODY"),
    card("an include in itself", "*INCLUDE, INPUT=deck.inp", "deck.inp|mesh.inp"),
    text("hyperelastic without numbers", "*HYPERELASTIC", "*ELASTIC", "deck.inp|ELASTIC", make=either),
    text("a modulus of NaN", "0.1,", "nan,", "deck.inp", "nan"),
    text("a modulus of 0", "0.1,", "0.,", "deck.inp", make=either),  # no equilibrium, which is an answer
    text("a modulus below 0", "0.1,", "-0.1,", "deck.inp", make=either),
    text("a time of 0", "*STATIC\n", "*STATIC\n0., 0.\n", "STATIC", make=either),
    bad("the solver: text", holds("builtin.json", "hello\n"), "builtin.json", place="deck", command=SIMULATE),
    bad("the solver: a list", holds("builtin.json", "[1]\n"), "builtin.json", place="deck", command=SIMULATE),
    bad("the solver: no name", holds("builtin.json", "{}\n"), "builtin.json", place="deck", command=SIMULATE),
    bad("the solver: a number as name", holds("builtin.json", '{"name": 3}\n'), "builtin.json|solver", place="deck", command=SIMULATE),
    bad("the solver: an unknown name", holds("builtin.json", '{"name": "calculx"}\n'), "calculx", place="deck", command=SIMULATE),
    bad("the solver: another version", holds("builtin.json", '{"name": "builtin", "version": "0"}\n'), "builtin.json", place="deck", command=SIMULATE),
    bad("the result into a folder", lambda place: (place / "s.npz").mkdir(), "s.npz", place="deck", command=SIMULATE),
    bad("the result into /proc", nothing, "/proc/s.npz", place="deck", command=(*SIMULATE[:-1], "/proc/s.npz")),
    bad("0 threads", nothing, "threads", place="deck", command=(*SIMULATE, "--threads", "0")),
    bad("-1 threads", nothing, "threads", place="deck", command=(*SIMULATE, "--threads", "-1")),
    bad("two threads in words", nothing, "threads", place="deck", command=(*SIMULATE, "--threads", "two")),
]  # fmt: skip
