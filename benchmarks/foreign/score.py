"""Count what run.py wrote against what is sealed: `python benchmarks/foreign/score.py FOLDER results.jsonl`.

Only the standard library is used. What is counted, and how, stands beside each line of the table.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Iterable
from pathlib import Path
from typing import Any

FAMILY = {
    "ageing": "loading",
    "band": "structure",
    "base_coulomb": "base",
    "base_friction": "base",
    "base_probe": "base",
    "base_slip": "base",
    "base_sticks": "base",
    "base_sticks_probe": "base",
    "bias_field": "observation",
    "body_gradient": "structure",
    "bone_mobility": "base",
    "coarse_mesh": "numerics",
    "compressibility": "material",
    "contrast_drift": "observation",
    "curved_indenter": "indenter",
    "debonding": "base",
    "displacement_gain": "loading",
    "distorted_in_space": "observation",
    "indenter_coulomb": "indenter",
    "indenter_debonding": "indenter",
    "distorted_pictures": "observation",
    "ellipse": "structure",
    "exponential": "material",
    "fibres": "material",
    "fibres_in_space": "material",
    "force_drift": "loading",
    "force_gain": "loading",
    "force_offset": "loading",
    "friction": "indenter",
    "geometry_probe": "geometry",
    "gradient": "structure",
    "guide_friction": "loading",
    "inclusion": "structure",
    "inclusion_in_space": "structure",
    "indenter_friction": "indenter",
    "indenter_place": "indenter",
    "indenter_probe": "indenter",
    "indenter_sticks": "indenter",
    "indenter_sticks_probe": "indenter",
    "indenter_probe_in_space": "indenter",
    "indenter_slip": "indenter",
    "intensity_drift": "observation",
    "interface": "geometry",
    "jumping_brightness": "observation",
    "jumping_pictures": "observation",
    "layer_ageing": "loading",
    "layer_compressibility": "material",
    "layer_stiffening": "material",
    "lens": "observation",
    "load_step": "numerics",
    "loading_probe": "loading",
    "material_probe": "material",
    "misregistration": "observation",
    "misregistration_in_space": "observation",
    "observation_probe": "observation",
    "onset": "loading",
    "nonlinear_sensor": "loading",
    "observation_probe_in_space": "observation",
    "outline": "geometry",
    "pixel_size": "observation",
    "preload": "state",
    "preshear": "state",
    "prestretch": "state",
    "prestretch_in_space": "state",
    "relaxation": "loading",
    "second_term": "material",
    "side_skin": "structure",
    "sideways": "indenter",
    "sideways_gradient": "structure",
    "sideways_in_space": "indenter",
    "skin": "structure",
    "soft_bed": "base",
    "soft_frame": "loading",
    "softening": "material",
    "split_layer": "structure",
    "state_probe": "state",
    "state_probe_in_space": "state",
    "stiffening": "material",
    "stretched_in_space": "observation",
    "stretched_pictures": "observation",
    "stiffness_field": "structure",
    "swelling": "state",
    "swollen": "state",
    "tilt": "indenter",
    "tilt_in_space": "indenter",
    "turned_in_space": "observation",
    "turned_pictures": "observation",
    "uneven_brightness": "observation",
    "wall": "indenter",
    "wandering_pictures": "observation",
    "yeoh": "material",
}
"""Family of each effect that comes with fingerfit, as this benchmark sees it."""
PROBES = {name for name in FAMILY if name.endswith(("_probe", "_probe_in_space"))} | {"stiffness_field"}
"""Effects that stand for a family: *of no known form* is not the name of a member."""
IN_SPACE = {
    "distorted_pictures": "distorted_in_space",
    "fibres": "fibres_in_space",
    "inclusion": "inclusion_in_space",
    "misregistration": "misregistration_in_space",
    "prestretch": "prestretch_in_space",
    "sideways": "sideways_in_space",
    "stretched_pictures": "stretched_in_space",
    "tilt": "tilt_in_space",
    "turned_pictures": "turned_in_space",
    "wandering_pictures": "misregistration_in_space",
}
ALIKE = {
    "stiffening": {"exponential", "softening", "yeoh"}, "inclusion": {"ellipse"},
    "base_slip": {"debonding", "base_friction"}, "indenter_slip": {"indenter_debonding", "indenter_friction"},
    "base_coulomb": {"base_sticks"}, "indenter_coulomb": {"indenter_sticks"},
    "bias_field": {"uneven_brightness"}, "force_offset": {"guide_friction"},
    "ageing": {"layer_ageing"}, "layer_stiffening": {"exponential", "softening", "yeoh"},
    "wandering_pictures": {"jumping_pictures"},
    "intensity_drift": {"jumping_brightness", "contrast_drift"},
}  # fmt: skip
"""Members that are as right: other laws of the same stiffening, an inclusion of any shape, a side that is loose from an
edge on or slips beyond a limit, brightness that is uneven in another form, an offset that the guide's
friction is, pictures that change from step to step by amounts of their own or by a power of their
brightness, one layer that ages (a form of its kind) or stiffens (all of these laws may be in one layer)."""
SINCE = {"one layer stiffens": "layer_stiffening"}
"""Kinds that the catalogue has had a member for since the truths of older halves were sealed, without one."""
CLOSE = 0.05
"""Share of a constant within which it is right."""
TRACE = 0.5
"""Size, in units of the noise, below which *adequate* is right as well."""
CLEAR = 1.0
"""Size from which an effect is as large as the noise: what must be found."""
SURE = "missing"
"""Verdict that names one effect; with *indistinguishable* several are named."""


def first(row: dict[str, Any]) -> dict[str, Any]:
    """What was said of the base model."""
    return row["rungs"][0] if row["rungs"] else {"verdict": "none", "named": [], "sentence": "", "parameters": {}}


def final(row: dict[str, Any]) -> dict[str, Any]:
    """What was said of the model that the climb ended with; where it has no answer yet, of the one with most effects.

    So it is in older rows, too, which do not tell that model.
    """
    known = [one for one in row["rungs"] if set(one["effects"]) == set(row.get("last", one["effects"]))]
    return (known or row["rungs"])[-1]


def families(rung: dict[str, Any]) -> list[str]:
    """Families that an answer means: that it names, else those of its effects, the first one first."""
    if rung.get("family"):
        return [rung["family"]] if isinstance(rung["family"], str) else list(rung["family"])
    found = [FAMILY[name] for name in rung["named"] if name in FAMILY]
    # effects of numerics are never added: the sentence says what to change
    if not found and "mesh too coarse" in rung.get("sentence", ""):
        found = ["numerics"]
    return list(dict.fromkeys(found))


def members(hidden: dict[str, Any]) -> set[str]:
    """Names in the catalogue of what is hidden."""
    own = hidden["member"] or SINCE.get(hidden["kind"])
    return {own, IN_SPACE.get(own, own), *ALIKE.get(own, ())} if own else set()


def found_in(row: dict[str, Any]) -> list[dict[str, Any]]:
    """What was said of all models."""
    return row["rungs"]


def family_right(row: dict[str, Any], truth: dict[str, Any]) -> bool:
    """One effect: the family that is named first is right. Pairs: each of both is named on some rung."""
    if len(truth["hidden"]) == 1:
        return bool(set(families(first(row))[:1]) & set(truth["hidden"][0]["families"]))
    said = {family for rung in found_in(row) for family in families(rung)}
    return all(said & set(one["families"]) for one in truth["hidden"])


def member_right(row: dict[str, Any], truth: dict[str, Any]) -> bool:
    """One effect: it is named, alone or in a set that cannot be told apart. Pairs: each of both on some rung."""
    if len(truth["hidden"]) == 1:
        return bool(set(first(row)["named"]) & members(truth["hidden"][0]))
    said = {name for rung in found_in(row) for name in rung["named"]}
    return all(said & members(one) for one in truth["hidden"])


def wrong_member(row: dict[str, Any], truth: dict[str, Any]) -> bool:
    """On some rung one effect is named, alone, that is not hidden."""
    right = set().union(*(members(one) for one in truth["hidden"]), set())
    return any(
        rung["verdict"] == SURE and rung["named"] and rung["named"][0] not in right | PROBES for rung in found_in(row)
    )


def wrong_family(row: dict[str, Any], truth: dict[str, Any]) -> bool:
    """The same, of no family of what is hidden."""
    right = {family for one in truth["hidden"] for family in one["families"]}
    return any(rung["verdict"] == SURE and not right & set(families(rung)) for rung in found_in(row))


def stopped(row: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether a climb ended adequate, with no more effects than are hidden."""
    return final(row)["verdict"] == "adequate" and len(final(row)["effects"]) <= len(truth["hidden"])


def constants(rung: dict[str, Any], truth: dict[str, Any], where: str = "interval") -> dict[str, tuple[float, bool]]:
    """Relative error of each constant, and whether its interval holds the truth.

    With "reach" as `where`, an interval reaches as far as effects that are not excluded would move the constant.

    That of a body that relaxes is the modulus of a fast load; fingerfit's, with relaxation, is that of a slow one.
    """
    found, relaxes = {}, sum(one["amount"] for one in truth["hidden"] if one["kind"] == "relaxation")
    slow = 1.0 - relaxes if "relaxation" in rung.get("effects", ()) else 1.0
    for name, fast in truth["constants"].items():
        true = slow * fast
        one = rung["parameters"].get(name)
        if one:
            low, high = one.get(where, one["interval"])
            found[name] = (one["value"] / true - 1, low <= true <= high)
    return found


def constants_right(rung: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Each constant within 5 % of the truth, or with the truth in its interval."""
    found = constants(rung, truth)
    return len(found) == len(truth["constants"]) and all(abs(e) <= CLOSE or inside for e, inside in found.values())


def size(truth: dict[str, Any]) -> float:
    """Size of all that is hidden, over the noise; of effects of numerics, which have none, infinite."""
    numbers = [x for key, x in truth["size"].items() if key != "absorbed" and x is not None]
    return float("inf") if truth["family"] == "numerics" else max(numbers, default=0.0)


def share(values: Iterable[bool]) -> str:
    """Count and share."""
    values = list(values)
    return f"{sum(values)} of {len(values)}" + (f" ({100 * sum(values) / len(values):.0f} %)" if values else "")


def summary(pairs: list[tuple[dict[str, Any], dict[str, Any]]]) -> list[tuple[str, str]]:
    """What is asked, and the answer, for rows with their truths."""
    told = [(row, truth) for row, truth in pairs if row["rungs"]]
    empty = [(row, truth) for row, truth in told if not truth["hidden"]]
    hidden = [(row, truth) for row, truth in told if truth["hidden"]]
    seen = [(row, truth) for row, truth in hidden if size(truth) >= TRACE]
    traces = [(row, truth) for row, truth in hidden if size(truth) < TRACE]
    known = [(row, truth) for row, truth in seen if all(members(one) for one in truth["hidden"])]
    covered = [inside for row, truth in empty for _, inside in constants(first(row), truth).values()]
    clear = [(row, truth) for row, truth in hidden if size(truth) >= CLEAR and truth["family"] != "numerics"]
    listed = [(row, truth) for row, truth in clear if all(members(one) for one in truth["hidden"])]
    climbed = [(row, truth) for row, truth in clear if family_right(row, truth) and row["goal"] == "discover"]
    ended = [(row, truth) for row, truth in told if final(row)["verdict"] == "adequate"]
    seconds = [row["seconds"] for row, _ in pairs]
    return [
        ("cases that were run; of them without any answer", f"{len(pairs)}; {len(pairs) - len(told)}"),
        ("ended with an error or out of time", share(row["code"] != 0 for row, _ in pairs)),
        (f"family right (hidden, size at least {TRACE:g})", share(family_right(*both) for both in seen)),
        ("member right (of these, those that the catalogue has)", share(member_right(*both) for both in known)),
        (f"clear cases (size at least {CLEAR:g}) of the catalogue: family right",
         share(family_right(*both) for both in listed)),
        ("the same: member right, or in the set that is named", share(member_right(*both) for both in listed)),
        ("clear cases with something that the catalogue lacks: family right",
         share(family_right(*both) for both in clear if both not in listed)),
        ("wrong member named with confidence, base model (all cases)",
         share(wrong_member({**row, "rungs": row["rungs"][:1]}, truth) for row, truth in told)),
        ("clear cases whose family was right: the climb stops after as many effects as are hidden, adequate",
         share(stopped(*both) for both in climbed)),
        ("of these climbs: all constants within 5 % or inside, last model",
         share(constants_right(final(row), truth) for row, truth in climbed)),
        ("wrong member named with confidence, on any rung (all hidden)", share(wrong_member(*both) for both in hidden)),
        ("of a wrong family", share(wrong_family(*both) for both in hidden)),
        (f"traces (size below {TRACE:g}): adequate, or the right family",
         share(first(row)["verdict"] == "adequate" or family_right(row, truth) for row, truth in traces)),
        ("nothing hidden: an effect named", share(bool(first(row)["named"]) for row, _ in empty)),
        ("nothing hidden: adequate", share(first(row)["verdict"] == "adequate" for row, _ in empty)),
        ("nothing hidden: all constants within 5 % or inside their intervals",
         share(constants_right(first(row), truth) for row, truth in empty)),
        ("nothing hidden: 95 % intervals that hold the truth", share(covered)),
        ("hidden: all constants within 5 % or inside, base model",
         share(constants_right(first(row), truth) for row, truth in hidden)),
        ("hidden: the same, last model", share(constants_right(final(row), truth) for row, truth in hidden)),
        ("adequate last models: constants inside their intervals",
         share(inside for row, truth in ended for _, inside in constants(final(row), truth).values())),
        ("the same, intervals reaching as far as with effects that are not excluded",
         share(held for row, truth in ended for _, held in constants(final(row), truth, "reach").values())),
        ("seconds of a climb: median; longest",
         f"{statistics.median(seconds):.0f}; {max(seconds):.0f}" if seconds else "-"),
    ]  # fmt: skip


def table(pairs: list[tuple[dict[str, Any], dict[str, Any]]]) -> str:
    """The counts, and a line for each case."""
    lines = ["| what is asked | so it is |", "| --- | --- |", *(f"| {a} | {b} |" for a, b in summary(pairs)), ""]
    lines += ["| case | hidden | size | verdict | named, model by model | error | constants | s |", "|" + " --- |" * 8]
    for row, truth in pairs:
        what = ", ".join(f"{one['kind']} ({one['form']})" for one in truth["hidden"]) or "nothing"
        named = " / ".join(" or ".join(rung["named"]) or rung["verdict"] for rung in row["rungs"]) or "-"
        model = final(row) if row["rungs"] else first(row)
        errors = ", ".join(f"{100 * e:+.1f}{'' if inside else '*'}" for e, inside in constants(model, truth).values())
        fell = ", ".join(f"{rung['error']['fitted']:.2f}" for rung in row["rungs"])
        ended = "" if row["code"] == 0 else f" ({row.get('message', 'failed')[:60]})"
        lines.append(
            f"| {row['name']} | {what} | {size(truth):.2g} | {first(row)['verdict']}{ended} | {named} | {fell} |"
            f" {errors} % | {row['seconds']:.0f} |"
        )
    return "\n".join([*lines, "", "Constants of the last model; * the interval does not hold the truth.", ""])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="what make.py was given as --out")
    parser.add_argument("results", type=Path, help="what run.py wrote")
    args = parser.parse_args()
    rows = [json.loads(line) for line in args.results.read_text(encoding="utf-8").splitlines() if line]
    pairs, failed = [], []
    for row in rows:
        truth = json.loads((args.folder / "sealed" / f"{row['name']}.json").read_text(encoding="utf-8"))
        failed += [row["name"]] if "failed" in truth else []
        pairs += [] if "failed" in truth else [(row, truth)]
    print(table(pairs))
    made = [json.loads(path.read_text(encoding="utf-8")) for path in sorted((args.folder / "sealed").glob("*.json"))]
    missing = sorted({truth["name"] for truth in made} - {row["name"] for row in rows})
    print(f"made, but not run: {', '.join(missing) or 'none'}")
    print(f"could not be made: {', '.join(truth['name'] for truth in made if 'failed' in truth) or 'none'}")


if __name__ == "__main__":
    main()
