"""The table of cases: drawn from a seed by the rules of rules.py. Another seed gives another half.

Nothing here computes anything: what a case is stands in plain numbers, and the same seed gives the same table.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from rules import PAIRS, RULES, SIZES, SPACE, SPACE_FORMS, SPACE_NUMBERS, VARIATIONS, Rule
from shapes import SHAPES

HALVES = {"study": 3, "exam": 1789}
"""Seeds of the two halves: *study* is for looking at, *exam* is made and run once."""
LAYER_NAMES = {
    1: ("body",),
    2: ("upper", "lower"),
    3: ("top", "middle", "bottom"),
    4: ("first", "second", "third", "fourth"),
}
TEXTURES = ("grain", "dots", "cells")


@dataclass(frozen=True)
class Hidden:
    """An effect that is in the data and not in the model; `size` is what is asked for, in units of the noise."""

    kind: str
    form: str
    families: tuple[str, ...]
    member: str | None
    size: float
    sign: int
    start: float
    largest: float
    numbers: Mapping[str, float]


@dataclass(frozen=True)
class Case:
    """One study: what is hidden in it, and what it is otherwise (`setting`, in mm, MPa, N, s)."""

    name: str
    half: str
    seed: int
    family: str
    hidden: tuple[Hidden, ...]
    setting: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for files."""
        return asdict(self)


def cases(half: str, seed: int | None = None, shaped: bool = False) -> list[Case]:
    """All cases of a half, in the order of the rules; with `shaped` those of the plane in bodies of other shapes.

    Raises
    ------
    KeyError
        Where the half is none of HALVES and comes without a seed.
    """
    seed = HALVES[half] if seed is None else seed
    made = [*_empty(half, seed), *_single(half, seed), *_pairs(half, seed), *_in_space(half, seed)]
    if shaped:
        made = [_shaped(case, seed) for case in made if case.setting["dimension"] == 2 and case.family != "numerics"]
    names = [case.name for case in made]
    assert len(set(names)) == len(names), "a name twice"
    return made


def _empty(half: str, seed: int) -> list[Case]:
    found = []
    for variation, wanted in VARIATIONS.items():
        name = _name("nothing", variation)
        rng = random.Random(f"{seed}/{name}")
        found.append(Case(name, half, _number(rng), "nothing", (), setting(rng, wanted)))
    return found


def _single(half: str, seed: int) -> list[Case]:
    rng = random.Random(f"{seed}/singles")
    wanted = [rule for rule in RULES for _ in range(rule.count)]
    sizes = list(itertools.islice(itertools.cycle(SIZES.values()), len(wanted)))
    rng.shuffle(sizes)
    found = []
    for rule in RULES:
        forms = rng.sample(rule.forms, min(rule.count, len(rule.forms)))
        for number in range(rule.count):
            name = _name(rule.kind, str(number + 1) if rule.count > 1 else "")
            own = random.Random(f"{seed}/{name}")
            hidden = draw(rule, forms[number % len(forms)], sizes.pop(), own)
            given = setting(own, rule.setting)
            if rule.kind == "coarse model":
                given = {**given, "model_mesh": hidden.form}
            found.append(Case(name, half, _number(own), rule.families[0], (hidden,), given))
    return found


def _pairs(half: str, seed: int) -> list[Case]:
    rng = random.Random(f"{seed}/pairs")
    found = []
    for kinds in rng.sample(PAIRS, 3):
        name = _name("pair", " and ".join(kinds))
        own = random.Random(f"{seed}/{name}")
        rules = [next(rule for rule in RULES if rule.kind == kind) for kind in kinds]
        hidden = tuple(draw(rule, own.choice(rule.forms), own.choice((1.5, 4.0)), own) for rule in rules)
        wanted = {key: value for rule in rules for key, value in rule.setting.items()}
        found.append(Case(name, half, _number(own), "pair", hidden, setting(own, wanted)))
    return found


def _in_space(half: str, seed: int) -> list[Case]:
    found = []
    for kind in SPACE:
        name = _name("space", kind)
        rng = random.Random(f"{seed}/{name}")
        hidden: tuple[Hidden, ...] = ()
        family = "nothing"
        if kind != "nothing":
            rule = next(rule for rule in RULES if rule.kind == kind)
            rule = replace(rule, numbers={**rule.numbers, **SPACE_NUMBERS.get(kind, {})})
            hidden = (draw(rule, rng.choice(SPACE_FORMS[kind]), rng.choice((1.5, 4.0)), rng),)
            family = rule.families[0]
        found.append(Case(name, half, _number(rng), family, hidden, setting_in_space(rng)))
    return found


def _shaped(case: Case, seed: int) -> Case:
    rng = random.Random(f"{seed}/{case.name}/shape")
    return replace(case, setting={**case.setting, "shape": rng.choice(SHAPES)})


def draw(rule: Rule, form: str, size: float, rng: random.Random) -> Hidden:
    """An effect of a kind, with its numbers."""
    numbers = {key: round(rng.uniform(*bounds), 4) for key, bounds in rule.numbers.items()}
    size = round(size * rng.uniform(0.85, 1.15), 3)
    sign = rng.choice(rule.signs)
    return Hidden(rule.kind, form, rule.families, rule.member, size, sign, rule.start, rule.largest, numbers)


def setting(rng: random.Random, wanted: Mapping[str, tuple[Any, ...]]) -> dict[str, Any]:
    """What a plane study is like; `wanted` has what must be so."""

    def take(key: str, usual: Sequence[Any]) -> Any:
        given = wanted.get(key, usual)
        if len(given) == 2 and all(isinstance(x, float) for x in given):
            return round(rng.uniform(*given), 5)
        return rng.choice(given)

    layers = take("layers", (2, 3, 3, 3, 4))
    width = take("width", (12.0, 12.0, 12.0, 18.0, 24.0))
    height = round(rng.uniform(11.0, 15.0 if width > 30 else 13.0), 1)
    heights = _heights(rng, height, layers)
    control = take("control", ("force", "force", "displacement"))
    seen = take("seen", ("pictures",))
    steps = take("steps", (5, 6, 7, 7, 8))
    aspect = width / height
    compress = take("compress", (0.11, 0.15) if aspect > 2 else (0.13, 0.19))
    schedule = take("schedule", ("even",))
    return {
        "dimension": 2,
        "width": width,
        "heights": heights,
        "names": list(LAYER_NAMES[layers]),
        "thickness": take("thickness", (20.0, 40.0, 70.0)),
        "mu": _moduli(rng, layers),
        "alpha": take("alpha", (1.4, 1.4, 1.4, 2.0)),
        "poisson": take("poisson", (0.495, 0.495, 0.49)),
        "rows": _whole(take("rows", (28, 30, 32)), wanted.get("rows"), rng),
        "compress": compress,
        "steps": steps,
        "times": _times(rng, steps, schedule),
        "pictured": [steps] if take("pictured", ("all",)) == "last" else list(range(1, steps + 1)),
        "fitted": _fitted(steps, wanted.get("pictured")),
        "control": control,
        "seen": seen,
        "picture": {
            "pixel": round(0.098 * math.sqrt(width / 12.0), 4),
            "texture": take("texture", TEXTURES),
            "grain": round(rng.uniform(3.0, 6.0), 2),
            "contrast": round(rng.uniform(0.12, 0.25), 3),
            "looks": _looks(rng, layers, take("looks", ("layered", "layered", "alike"))),
            "blur": take("blur", (0.6, 1.1)),
        },
        "noise": {
            "picture": take("picture_noise", (0.015, 0.03)),
            "force_share": take("force_noise", (0.004, 0.01)),
            "displacement": 0.01,
            "points": 0.015,
        },
        "model_mesh": "usual",
    }


def setting_in_space(rng: random.Random) -> dict[str, Any]:
    """A brick of two layers in volumes of about 48 x 48 x 40."""
    wanted = {"layers": (2,), "width": (12.0,), "alpha": (2.0,), "poisson": (0.48,), "steps": (4,), "rows": (9,)}
    given = setting(rng, {**wanted, "compress": (0.08, 0.11)})
    height = sum(given["heights"])
    given["picture"].update(pixel=round(1.5 * height / 40, 3), grain=round(rng.uniform(2.5, 3.5), 2), contrast=0.25)
    return {**given, "dimension": 3, "breadth": 12.0, "fitted": [2, 4], "control": "force"}


def _heights(rng: random.Random, height: float, layers: int) -> list[float]:
    """Heights of the layers from the top, none less than half of another; their sum is the height."""
    shares = [rng.uniform(0.75, 1.25) for _ in range(layers)]
    cut = [round(height * share / sum(shares), 1) for share in shares]
    return [*cut[:-1], round(height - sum(cut[:-1]), 1)]


def _moduli(rng: random.Random, layers: int) -> list[float]:
    """Shear moduli in MPa, neighbours between 1.4 and 2.2 times apart."""
    found = [rng.uniform(0.015, 0.04)]
    while len(found) < layers:
        ratio = math.exp(rng.choice((-1, 1)) * rng.uniform(math.log(1.4), math.log(2.2)))
        if 0.006 <= found[-1] * ratio <= 0.09:
            found.append(found[-1] * ratio)
    return [round(mu, 5) for mu in found]


def _looks(rng: random.Random, layers: int, looks: str) -> list[float]:
    """Brightness of the layers, as shares of full scale."""
    if looks == "alike":
        return [round(rng.uniform(0.5, 0.7), 3)] * layers
    first = rng.choice((0.45, 0.75))
    return [round((first if n % 2 == 0 else 1.2 - first) + rng.uniform(-0.05, 0.05), 3) for n in range(layers)]


def _times(rng: random.Random, steps: int, schedule: str) -> list[float]:
    """End of each step, s; an uneven schedule has quick and slow steps in turn."""
    if schedule == "even":
        return [60.0 * (k + 1) for k in range(steps)]
    lasts = [rng.uniform(4, 10) if k % 2 == 0 else rng.uniform(60, 150) for k in range(steps)]
    return [round(t, 1) for t in itertools.accumulate(lasts)]


def _fitted(steps: int, pictured: Any) -> list[int]:
    """Steps that the model is fitted to; the others are held out. With one picture it is fitted."""
    return [steps] if pictured else sorted({*range(1, steps + 1, 2), steps})


def _whole(value: Any, bounds: tuple[Any, ...] | None, rng: random.Random) -> int:
    return rng.randint(*bounds) if bounds and len(bounds) == 2 else int(value)


def _name(kind: str, more: str) -> str:
    return "-".join(f"{kind} {more}".split())


def _number(rng: random.Random) -> int:
    """Seed of the texture and of all noise."""
    return rng.randrange(2**31)
