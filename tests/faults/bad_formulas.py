"""Formulas of effects: a sandbox of numbers."""

from battery import bad, fine, put

AREA = "formulas"
FILE = "study/effects/own.yaml"


def deck(formula, *says, **more):
    """As what goes into the deck."""
    return more.pop("make", bad)(
        f"field: {formula[:40]}", put(FILE, "changes.field", formula), "own", *(says or ["field"]), **more
    )


def seen(formula, *says, **more):
    """As what is measured."""
    return more.pop("make", bad)(
        f"force: {formula[:40]}", put(FILE, "observes.force", formula), "own", *(says or ["force"]), **more
    )


DEEP = "(" * 2000 + "1" + ")" * 2000
CASES = [
    deck("size +"),
    deck("size ** "),
    deck("siez"),
    deck("size * depht", "depht|field"),
    deck("size / 0"),
    deck("size / (x - x)"),
    deck("log(-1 - x)"),
    deck("sqrt(-1 - x)"),
    deck("exp(1000 * (1 + x))"),
    deck("1e308 * 10 * (1 + size)"),
    deck("size.__class__"),
    deck("().__class__.__bases__[0].__subclasses__()"),
    deck("''.__class__.__mro__"),
    deck("__import__('os').mkdir('ran')"),
    deck("open('/etc/passwd')"),
    deck("exp.__globals__"),
    deck("self._TemplateReference__context"),
    deck("lipsum.__globals__"),
    deck("range(10 ** 9)"),
    deck("size == 0.1 and open"),
    deck("[x, y]"),
    deck("'text'"),
    deck("{'a': 1}"),
    deck("none"),
    deck("exp()"),
    deck("exp(x, x)"),
    deck("exp(x, out=x)"),
    deck("where(x > 1, 1)"),
    deck("x | replace('1', '2')"),
    deck("x is divisibleby 2"),
    deck("size if x > 1 else 0"),  # of many places at once
    deck("exp('a')"),
    deck("'a' * size"),
    deck("size; x"),
    deck("size }}{{ x"),
    deck("{% for a in b %}"),
    deck("1" * 5000),
    deck("9**9**9"),
    deck("9**9**9**9 * size"),
    deck("2 ** 10000000000"),
    deck("'x' * 10**10"),
    deck("[0] * 10**10"),
    deck("'%99999999999d' % 1"),
    deck(DEEP),
    deck("-" * 5000 + "1"),
    deck("+".join(["size"] * 5000)),
    deck("0 * size", make=fine),
    deck("size * x ** 2", make=fine),
    seen("force * siez"),
    seen("force / 0 * size"),
    seen("force.sum()"),
    seen("force.fill(0)"),
    seen("force[0]"),  # one number for all steps
    seen("'a'"),
    seen("9**9**9 * force"),
    seen("force * (1 + size)", make=fine),
    bad("alpha: 0 * size", put(FILE, "changes", {"alpha": "0 * size"}), "own", "alpha"),
    bad("poisson: 0.5 + size", put(FILE, "changes", {"poisson": "0.5 + size"}), "own", "poisson"),
    bad("poisson: 2", put(FILE, "changes", {"poisson": "2"}), "own", "poisson"),
    bad("increment: -size", put(FILE, "changes", {"increment": "-1 - size"}), "own", "increment"),
    bad("increment: 0 * size", put(FILE, "changes", {"increment": "0 * size"}), "own", "increment"),
    bad("force: log(-1)", put(FILE, "changes", {"force": "log(-1) * force"}), "own", "force"),
    bad("shift_x: 'a'", put(FILE, "observes", {"shift_x": "'a' * 3"}), "own", "shift_x"),
    bad("shift_x: k[0]", put(FILE, "observes", {"shift_x": "k[0] + size"}), "own", "shift_x"),
    bad("intensity: unknown", put(FILE, "observes", {"intensity": "intensity + sizee"}), "own", "intensity"),
    bad("intensity: NaN", put(FILE, "observes", {"intensity": "intensity * log(-size)"}), "own", "intensity"),
]  # fmt: skip
