"""Which effects are hidden in which study."""

from __future__ import annotations

from collections.abc import Callable

import hidden_body
import hidden_setup
from hidden import Effects
from study_table import Study

HIDDEN: dict[str, tuple[Callable[[Study, float], Effects], float]] = {
    "h01": (hidden_setup.compliant_frame, 0.14),
    "h03": (hidden_setup.relaxation, 0.38),
    "h04": (hidden_setup.foam_tape, 0.06),
    "h05": (hidden_setup.camera_comes_closer, 0.035),
    "h06": (hidden_body.inclined_interface, 0.2),
    "h07": (hidden_body.stiff_skin, 5.0),
    "h08": (hidden_setup.friction, 0.2),
    "h09": (hidden_body.preload, 0.055),
    "h11": (hidden_body.fibres, 2.0),
    "h14": (hidden_setup.wall, 0.03),
    "h15": (hidden_body.stiffening, 9.0),
    "h16": (hidden_body.bubbles, 0.12),
}
"""What is hidden, and its size in series 0; in the other studies nothing is."""
OTHER = (0.7, 1.1)
"""Smallest and largest size in another series, over that in series 0."""


def effects_of(study: Study) -> Effects:
    """What is hidden in a study; another series has another size."""
    if study.name not in HIDDEN:
        return Effects()
    function, size = HIDDEN[study.name]
    if study.series:
        size = float(f"{size * study.generator('sizes').uniform(*OTHER):.2g}")
    return function(study, size)
