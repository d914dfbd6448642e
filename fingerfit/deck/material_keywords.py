"""Keywords of materials, orientations and sections."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from fingerfit.deck.cards import Card
from fingerfit.deck.content import Orientation, Section
from fingerfit.deck.state import Handler, Reading
from fingerfit.material.isotropic import Isotropic
from fingerfit.material.spread import structure_of

_MODELS = ("OGDEN", "NEO HOOKE", "MOONEY-RIVLIN", "YEOH", "REDUCED POLYNOMIAL", "MARLOW")
_ORDERS = 6
"""Terms of an energy at most, as in ABAQUS."""


def on_material(reading: Reading, card: Card) -> None:
    card.allow("NAME")
    reading.material = card.need("NAME")


def on_hyperelastic(reading: Reading, card: Card) -> None:
    card.allow(*_MODELS, "N", "MODULI")
    chosen = [model for model in _MODELS if model in card.options]
    if len(chosen) != 1:
        raise card.error(", ".join(card.options) or "nothing", "one of " + ", ".join(_MODELS))
    model = chosen[0]
    if model == "MARLOW":
        card.values(0, 0)
        reading.tested[reading.material] = card, {}
        return
    order = 3 if model == "YEOH" else card.whole(card.options.get("N") or "1", card.line)
    if not 1 <= order <= _ORDERS:
        raise card.error(f"N={order}", f"N from 1 to {_ORDERS}")
    count = {"OGDEN": 3 * order, "NEO HOOKE": 2, "MOONEY-RIVLIN": 3}.get(model, 2 * order)
    values = card.values()
    # a temperature after each set of constants: they depend on it
    sets, rest = divmod(len(values), count + 1)
    if len(values) != count and (rest or not sets):
        order_of = {
            "OGDEN": "mu and alpha of each term, then D",
            "NEO HOOKE": "C10, D",
            "MOONEY-RIVLIN": "C10, C01, D",
            "YEOH": "C10, C20, C30, D1, D2, D3",
            "REDUCED POLYNOMIAL": "C10 to CN0, D1 to DN",
        }
        expected = f"{count}: {order_of[model]}; or sets of {count + 1}, each with its temperature"
        raise card.error(f"{len(values)} constants", expected)
    if len(values) == count:
        reading.materials[reading.material] = _moduli(card, _hyperelastic(card, model, order, values))
        return
    rows = np.reshape(values, (sets, count + 1))
    if not (np.diff(rows[:, -1]) > 0).all():
        raise card.error(rows[:, -1].tolist(), "temperatures from the lowest on, each once")
    warmed = [(float(row[-1]), _moduli(card, _hyperelastic(card, model, order, row[:-1].tolist()))) for row in rows]
    if len({structure_of(material) for _, material in warmed}) > 1:
        raise card.error("D = 0 at some temperatures", "as many D at all of them")
    reading.warmed[reading.material], reading.materials[reading.material] = warmed, warmed[0][1]


def _hyperelastic(card: Card, model: str, order: int, values: list[float]) -> Isotropic:
    """A material by its constants; each kind is loaded when a deck names it."""
    if model == "OGDEN":
        from fingerfit.material.ogden import Ogden

        if min(values[1 : 2 * order : 2], key=abs) == 0:
            raise card.error(values, "alpha other than 0")
        d = _compressibility(card, values[2 * order :])
        return Ogden(tuple(values[0 : 2 * order : 2]), tuple(values[1 : 2 * order : 2]), d)
    if model == "NEO HOOKE":
        from fingerfit.material.neo_hooke import NeoHooke

        return NeoHooke(values[0], _compressibility(card, values[1:]))
    if model == "MOONEY-RIVLIN":
        from fingerfit.material.mooney_rivlin import MooneyRivlin

        return MooneyRivlin(values[0], values[1], _compressibility(card, values[2:]))
    from fingerfit.material.yeoh import Yeoh

    return Yeoh(tuple(values[:order]), _compressibility(card, values[order:]))


def on_test_data(reading: Reading, card: Card) -> None:
    """*UNIAXIAL or *VOLUMETRIC TEST DATA of Marlow's law, which is complete when both are there."""
    from fingerfit.material.marlow import Marlow

    card.allow()
    if reading.material not in reading.tested:
        raise card.error("another law", "*HYPERELASTIC, MARLOW before it")
    opening, given = reading.tested[reading.material]
    given[card.name] = card
    if len(given) < 2:
        return
    uniaxial, volumetric = given["UNIAXIAL TEST DATA"], given["VOLUMETRIC TEST DATA"]
    d = (_bulk(volumetric),)
    made = list[tuple[float, Isotropic]]()
    for temperature, rows in _tests(uniaxial).items():
        strain, stress = zip(*rows, strict=True)
        if len(rows) < 2 or strain[0] <= 0 or not all(low < high for low, high in pairwise(strain)):
            raise uniaxial.error(list(strain), "two nominal strains or more above 0, each larger than that before")
        made.append((temperature, _moduli(opening, Marlow(strain, stress, d))))
    if not all(low < high for (low, _), (high, _) in pairwise(made)):
        raise uniaxial.error([one for one, _ in made], "temperatures from the lowest on, each once")
    if len({structure_of(material) for _, material in made}) > 1:
        raise uniaxial.error("other numbers of strains at other temperatures", "as many strains at all of them")
    reading.materials[reading.material] = made[0][1]
    if len(made) > 1:
        reading.warmed[reading.material] = made
    del reading.tested[reading.material]


def _tests(card: Card) -> dict[float, list[tuple[float, float]]]:
    """Strains and stresses of each temperature, in the order of the deck; of 0 where there is none."""
    found: dict[float, list[tuple[float, float]]] = {}
    for line, row in card.rows(2):
        if len(row) > 4 or (len(row) > 2 and row[2]):
            raise card.error(row, "nominal stress and strain; then an empty field and the temperature", line)
        stress, strain = (card.number(text, line) for text in row[:2])
        found.setdefault(card.number(row[3], line) if len(row) > 3 else 0.0, []).append((strain, stress))
    if not found:
        raise card.error("no data", "nominal stress and strain of each point")
    return found


def _bulk(card: Card) -> float:
    """D of pressures in proportion to the volume that is lost."""
    rows = [[card.number(text, line) for text in row] for line, row in card.rows(2)]
    if not rows:
        raise card.error("no data", "pressure and volume ratio J")
    if any(len(row) != 2 or row[1] == 1 or row[0] * (1 - row[1]) <= 0 for row in rows):
        raise card.error(rows, "pressure and volume ratio J: a pressure above 0 where J is below 1, below 0 above it")
    pressure, ratio = np.transpose(rows)
    found = 2 * (1 - ratio) / pressure
    if np.ptp(found) > 1e-6 * found[0]:
        raise card.error(rows, "pressures in proportion to 1 - J")
    return float(found[0])


def _compressibility(card: Card, values: list[float]) -> tuple[float, ...]:
    """D of each order; those that are 0 at the end are left out, as their terms are absent then.

    Hybrids have no unknown of their own for the pressure, so that D = 0 cannot be solved.
    """
    while len(values) > 1 and values[-1] == 0:
        values = values[:-1]
    if not any(values):
        raise card.error("D = 0, incompressible", "D above 0: in hybrids, 2e-4 over the shear modulus is nearly that")
    if min(values) <= 0:
        raise card.error(f"D {values}", "D above 0")
    return tuple(values)


def _moduli(card: Card, material):  # type: ignore[no-untyped-def]
    """Keep whether constants are those of a fast or of a slow load, for *VISCOELASTIC after it."""
    from fingerfit.material.prony import Prony

    moduli = card.options.get("MODULI", "LONG TERM").upper()
    if moduli not in ("LONG TERM", "INSTANTANEOUS"):
        raise card.error(moduli, "LONG TERM or INSTANTANEOUS")
    return replace(material, prony=Prony((), (), True)) if moduli == "INSTANTANEOUS" else material


def on_elastic(reading: Reading, card: Card) -> None:
    from fingerfit.material.elastic import Elastic

    card.allow("TYPE", "MODULI")
    if card.options.get("TYPE", "ISOTROPIC").upper() not in ("ISOTROPIC", "ISO"):
        raise card.error(card.options["TYPE"], "ISOTROPIC")
    young, poisson, *_ = card.values(2, 3)
    if young <= 0 or not -1 < poisson < 0.5:
        raise card.error([young, poisson], "Young's modulus above 0 and Poisson's ratio below 0.5")
    reading.materials[reading.material] = _moduli(card, Elastic(young, poisson))


def on_anisotropic_hyperelastic(reading: Reading, card: Card) -> None:
    from fingerfit.material.holzapfel import Holzapfel

    card.allow("HOLZAPFEL", "LOCAL DIRECTIONS", "MODULI")
    if "HOLZAPFEL" not in card.options:
        raise card.error(", ".join(card.options) or "nothing", "HOLZAPFEL")
    c10, d, k1, k2, kappa = (*card.values(4, 5), 0.0)[:5]
    if d <= 0 or k2 <= 0 or not 0 <= kappa <= 1 / 3:
        raise card.error([c10, d, k1, k2, kappa], "C10, D above 0, k1, k2 above 0, kappa from 0 to 1/3")
    count = card.whole(card.options.get("LOCAL DIRECTIONS") or "1", card.line)
    axes = tuple(tuple(row) for row in np.eye(3)[:count].tolist())
    reading.materials[reading.material] = _moduli(card, Holzapfel(c10, d, k1, k2, kappa, axes))


def on_viscoelastic(reading: Reading, card: Card) -> None:
    from fingerfit.material.prony import Prony

    card.allow("TIME")
    if card.options.get("TIME", "").upper() != "PRONY":
        raise card.error(card.options.get("TIME", "nothing"), "TIME=PRONY")
    material = reading.materials.get(reading.material)
    if material is None:
        raise card.error("no elastic constants", "*HYPERELASTIC or *ELASTIC before it")
    g, k, tau = list[float](), list[float](), list[float]()
    for line, row in card.rows():
        values = [card.number(v, line) if v else 0.0 for v in row]
        if len(values) != 3 or min(values[:2]) < 0 or values[2] <= 0:
            raise card.error(row, "g, k and tau: g and k from 0 to 1, tau above 0", line)
        for series, value in zip((g, k, tau), values, strict=True):
            series.append(value)
    if not g or max(sum(g), sum(k)) >= 1:
        raise card.error([g, k], "moduli g and k whose sums are below 1")
    prony = Prony(tuple(g), tuple(tau), material.prony is not None, tuple(k) if any(k) else ())
    reading.materials[reading.material] = replace(material, prony=prony)
    if reading.material in reading.warmed:
        warmed = reading.warmed[reading.material]
        reading.warmed[reading.material] = [(at, replace(one, prony=prony)) for at, one in warmed]


def on_expansion(reading: Reading, card: Card) -> None:
    """Expansion from the initial temperature on: of a coefficient that is constant ZERO changes nothing."""
    card.allow("TYPE", "ZERO")
    if card.options.get("TYPE", "ISO").upper() != "ISO":
        raise card.error(card.options["TYPE"], "ISO")
    reading.expansion[reading.material] = card.values(1, 1)[0]


def on_density(reading: Reading, card: Card) -> None:
    """Statics without gravity need none."""


def on_orientation(reading: Reading, card: Card) -> None:
    from fingerfit.fem.rigid import rotation_matrix

    card.allow("NAME", "SYSTEM", "DEFINITION", "LOCAL DIRECTIONS")
    if card.options.get("SYSTEM", "RECTANGULAR").upper() not in ("RECTANGULAR", "R"):
        raise card.error(card.options["SYSTEM"], "RECTANGULAR")
    if card.options.get("DEFINITION", "COORDINATES").upper() != "COORDINATES":
        raise card.error(card.options["DEFINITION"], "COORDINATES")
    rows = [[card.number(v, line) if v else 0.0 for v in row] for line, row in card.rows()]
    count = card.whole(card.options.get("LOCAL DIRECTIONS") or "0", card.line)
    if not rows or len(rows[0]) not in (6, 9) or len(rows) < 1 + count:
        raise card.error(f"{len(rows)} lines", "a and b of six numbers, and a line for each local direction")
    origin = np.array(rows[0][6:9] or [0.0, 0.0, 0.0])
    x = np.array(rows[0][:3]) - origin
    z = np.cross(x, np.array(rows[0][3:6]) - origin)
    if np.linalg.norm(z) == 0:
        raise card.error(rows[0], "points a and b that are not in line with the origin")
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    axes = np.array([x, np.cross(z, x), z])
    extra = rows[1 : len(rows) - count]
    if extra and extra[0]:
        if extra[0][0] not in (1, 2, 3):
            raise card.error(extra[0], "an axis 1, 2 or 3 and an angle in degrees")
        axis = axes[int(extra[0][0]) - 1]
        axes = axes @ rotation_matrix(np.deg2rad(extra[0][1] if len(extra[0]) > 1 else 0.0) * axis).T
    directions = []
    for row in rows[len(rows) - count :]:
        vector = np.array((row + [0.0] * 3)[:3])
        if not vector.any():
            raise card.error(row, "a direction other than 0")
        directions.append(tuple((vector / np.linalg.norm(vector)).tolist()))
    reading.orientations[reading.name(card.need("NAME"))] = Orientation(axes, tuple(directions))


def on_solid_section(reading: Reading, card: Card) -> None:
    card.allow("ELSET", "MATERIAL", "ORIENTATION", "CONTROLS")
    rows = list(card.rows())
    if len(rows) > 1:
        raise card.error(", ".join(rows[1][1]), "one line of data: the thickness", rows[1][0])
    thickness = next((card.number(row[0], line) for line, row in rows if row and row[0]), 1.0)
    elset = reading.find(reading.elsets, card.need("ELSET")) or card.need("ELSET")
    orientation = ""
    if "ORIENTATION" in card.options:
        found = reading.find(reading.orientations, card.need("ORIENTATION"))
        if found is None:
            raise card.error(card.options["ORIENTATION"], "an orientation defined before")
        orientation = found
    reading.sections.append((Section(elset, card.need("MATERIAL"), thickness, orientation), card))


def on_section_controls(reading: Reading, card: Card) -> None:
    """Hourglass control: no element here has any, so that it changes nothing."""
    card.allow("NAME", "HOURGLASS")


KEYWORDS: dict[str, Handler] = {
    "MATERIAL": on_material,
    "HYPERELASTIC": on_hyperelastic,
    "ELASTIC": on_elastic,
    "UNIAXIAL TEST DATA": on_test_data,
    "VOLUMETRIC TEST DATA": on_test_data,
    "ANISOTROPIC HYPERELASTIC": on_anisotropic_hyperelastic,
    "VISCOELASTIC": on_viscoelastic,
    "EXPANSION": on_expansion,
    "DENSITY": on_density,
    "ORIENTATION": on_orientation,
    "SOLID SECTION": on_solid_section,
    "SECTION CONTROLS": on_section_controls,
}
