"""What describes a study; the studies themselves are in cases.yaml."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

Layer = tuple[str, float, float]  # name, height in mm, mu in MPa; from the indenter down


@dataclass
class Case:
    """One study.

    Attributes
    ----------
    strain
        Largest displacement of the plate as a share of the height.
    pixels
        Pixels over the width.
    noise
        Kind of the noise of pictures, its size as a share of full scale, how it is stated.
    reading
        Standard deviation of the measured response, as a share of its largest value.
    effects
        What is hidden: name and numbers, see `make.py`.
    hidden
        The same in words: family and what.
    """

    title: str
    width: float
    thickness: float
    layers: tuple[Layer, ...]
    alpha: float
    nu: float
    control: str
    base: str
    indenter: str
    strain: float
    steps: int
    pixels: int
    texture: str
    noise: tuple[str, float, str]
    reading: float = 0.005
    origin: tuple[float, float] = (0.0, 0.0)
    effects: dict[str, Any] = field(default_factory=dict)
    hidden: tuple[tuple[Any, str], ...] = ()


CASES = {
    name: Case(**values) for name, values in yaml.safe_load((Path(__file__).parent / "cases.yaml").read_text()).items()
}
