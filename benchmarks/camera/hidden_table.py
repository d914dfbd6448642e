"""Which effects are hidden in which study."""

from __future__ import annotations

from collections.abc import Callable

import hidden_body
import hidden_setup
from hidden import Effects
from study_table import Study

HIDDEN: dict[str, tuple[Callable[..., Effects], tuple[float, ...]]] = {
    "w02": (hidden_body.fibres, (0.32,)),
    "w03": (hidden_setup.bending_plate, (0.075,)),
    "w05": (hidden_setup.distorting_lens, (0.045,)),
    "w06": (hidden_body.soft_spot, (0.55,)),
    "w08": (hidden_setup.stiffening_and_guide, (0.2, 0.01)),
    "w09": (hidden_setup.loose_base, (0.33,)),
    "w10": (hidden_setup.relaxation, (0.2,)),
    "w12": (hidden_body.curved_interface, (0.085,)),
    "w13": (hidden_body.preload, (0.035,)),
    "w14": (hidden_setup.soft_adhesive_and_lamp, (0.08, 0.1)),
    "w16": (hidden_body.dried_skin, (1.3,)),
}
"""What is hidden, and its sizes; in the other studies nothing is."""


def effects_of(study: Study) -> Effects:
    """What is hidden in a study."""
    if study.name not in HIDDEN:
        return Effects()
    function, sizes = HIDDEN[study.name]
    return function(study, *sizes)
