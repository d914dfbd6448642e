"""The table of the studies: bodies, tests, textures and noise. Lengths in mm, forces in N, moduli in MPa."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

APART = 1_000_000
"""How far the seeds of two series are apart."""


@dataclass(frozen=True)
class Layer:
    """A layer, with its shear modulus at small strain."""

    name: str
    height: float
    modulus: float


@dataclass(frozen=True)
class Look:
    """How the pictures look.

    Parameters
    ----------
    texture : str
        A name in texture.PATTERNS.
    columns, rows : int
        Pixels of a picture.
    noise : float
        Standard deviation over the level.
    blur : float
        Standard deviation of the camera's blur, pixels.
    magnitude : bool
        Whether the noise is magnitude noise (Rician), else Gaussian.
    level : float
        Intensity in the files where the texture is 1.
    whole : bool
        Whether the files have whole numbers (int16), else float32.
    """

    texture: str
    columns: int
    rows: int
    noise: float
    blur: float = 0.0
    magnitude: bool = False
    level: float = 3000
    whole: bool = True

    @property
    def sigma(self) -> float:
        """Standard deviation of the noise in the files."""
        sigma = self.noise * self.level
        return round(sigma) if self.whole else sigma


@dataclass(frozen=True)
class Study:
    """A compression test.

    Parameters
    ----------
    name, title : str
        Name of the folder, and what the test is.
    seed : int
        Seed of the steps, the texture and the noise of the pictures.
    width, thickness : float
        Of the body, mm.
    layers : tuple of Layer
        From the indenter to the base.
    alpha, poisson : float
        Exponent of the law and Poisson ratio, alike in all layers.
    control : str
        What is prescribed: displacement or force.
    base, indenter : str
        The base is held or slides; the indenter is glued or slides.
    compression : float
        Largest indentation over the height.
    steps : int
        Number of steps.
    pictured, fitted : tuple of int
        Steps that have a picture, and those of them that are fitted; the others are held out.
    look : Look
        Of the pictures.
    force_noise : float
        Standard deviation over the largest force.
    waits : float or tuple of float or None
        Time from step to step, s; no times are written without it.
    origin : tuple of int
        Place of the body's lower left corner, mm.
    elements : int
        Elements over the width.
    grading : float
        Size of the elements in the middle over that at the surfaces.
    series : int
        Other series have other seeds.
    """

    name: str
    seed: int
    title: str
    width: float
    thickness: float
    layers: tuple[Layer, ...]
    alpha: float
    poisson: float
    control: str
    compression: float
    steps: int
    pictured: tuple[int, ...]
    fitted: tuple[int, ...]
    look: Look
    force_noise: float
    base: str = "held"
    indenter: str = "glued"
    waits: float | tuple[float, ...] | None = None
    origin: tuple[int, int] = (0, 0)
    elements: int = 24
    grading: float = 3.0
    series: int = 0

    @property
    def height(self) -> float:
        """Height of the body, mm."""
        return sum(layer.height for layer in self.layers)

    @property
    def times(self) -> np.ndarray | None:
        """Times of the steps (steps,), s."""
        return None if self.waits is None else np.cumsum(np.broadcast_to(self.waits, self.steps))

    def generator(self, use: Literal["steps", "pictures", "readings", "sizes"]) -> np.random.Generator:
        """Random numbers for one use: indentations and bubbles, pictures, what is measured, sizes of what is hidden."""
        number = int(self.name[1:])
        seeds = {
            "steps": 7 * self.seed + 1,
            "pictures": 13 * self.seed + 5,
            "readings": 1009 * number + 3,
            "sizes": 1013 * number + 11,
        }
        return np.random.default_rng(seeds[use] + APART * self.series)


# fmt: off
STUDIES = [
    Study("h01", 77, "Three-layer rubber block in a bench-top press", 22, 30,
          (Layer("t", 6, 0.1), Layer("m", 7, 0.06), Layer("b", 7, 0.12)), alpha=3.0, poisson=0.49,
          control="displacement", compression=0.1, steps=6, pictured=(2, 4, 6), fitted=(2, 6),
          look=Look("blobs", 160, 160, 0.015), force_noise=0.003, waits=20),
    Study("h02", 80, "Two rubber layers between lubricated plates", 18, 18,
          (Layer("x", 8, 0.07), Layer("y", 10, 0.04)), alpha=4.0, poisson=0.493,
          control="displacement", compression=0.2, steps=7, pictured=(1, 3, 4, 5, 7), fitted=(1, 3, 5, 7),
          look=Look("grains", 160, 160, 0.01), force_noise=0.005, base="slides", indenter="slides", waits=20,
          elements=28, grading=4.0),
    Study("h03", 72, "Small bilayer gel, MRI during compression", 16, 20,
          (Layer("gel", 6, 0.02), Layer("foundation", 8, 0.05)), alpha=2.0, poisson=0.49,
          control="displacement", compression=0.13, steps=8, pictured=(2, 4, 5, 6, 8), fitted=(2, 4, 6, 8),
          look=Look("blobs", 160, 150, 0.02, magnitude=True), force_noise=0.004, waits=(2, 3, 3, 40, 3, 60, 4, 120)),
    Study("h04", 69, "Soft pad on a firmer one, MRI", 20, 25,
          (Layer("soft", 7, 0.012), Layer("hard", 9, 0.03)), alpha=2.0, poisson=0.494,
          control="force", compression=0.0943, steps=5, pictured=(2, 3, 5), fitted=(2, 5),
          look=Look("grains", 150, 140, 0.02, magnitude=True), force_noise=0.005, waits=20),
    Study("h05", 76, "Miniature two-layer pad, camera", 12, 15,
          (Layer("epi", 5, 0.04), Layer("sub", 7, 0.02)), alpha=2.0, poisson=0.49,
          control="force", compression=0.12, steps=5, pictured=(1, 3, 4, 5), fitted=(1, 3, 5),
          look=Look("speckle", 140, 140, 0.01), force_noise=0.005, waits=20),
    Study("h06", 75, "Two-layer silicone block with fibrous texture", 28, 40,
          (Layer("upper", 12, 0.025), Layer("lower", 14, 0.06)), alpha=1.8, poisson=0.494,
          control="force", compression=0.113535, steps=7, pictured=(1, 3, 5, 6, 7), fitted=(1, 3, 5, 7),
          look=Look("fibres", 180, 180, 0.01, level=1.0, whole=False), force_noise=0.005, waits=20, elements=26),
    Study("h07", 68, "Sandwich of three gels under a lubricated plate, ultrasound", 36, 36,
          (Layer("one", 10, 0.02), Layer("two", 10, 0.045), Layer("three", 10, 0.03)), alpha=3.0, poisson=0.49,
          control="force", compression=0.125, steps=7, pictured=(2, 3, 5, 6, 7), fitted=(2, 5, 7),
          look=Look("speckle", 210, 190, 0.01, blur=0.6), force_noise=0.004, indenter="slides"),
    Study("h08", 70, "Two-layer elastomer between lubricated plates", 26, 26,
          (Layer("a", 9, 0.08), Layer("b", 13, 0.05)), alpha=4.0, poisson=0.493,
          control="displacement", compression=0.16, steps=6, pictured=(2, 4, 5, 6), fitted=(2, 4, 6),
          look=Look("fibres", 190, 170, 0.01), force_noise=0.005, base="slides", indenter="slides", elements=20),
    Study("h09", 73, "Large gelatine phantom of three layers, ultrasound", 60, 100,
          (Layer("fat", 15, 0.004), Layer("muscle", 17, 0.009), Layer("deep", 13, 0.006)), alpha=2.0, poisson=0.49,
          control="force", compression=0.11, steps=6, pictured=(2, 4, 5, 6), fitted=(2, 4, 6),
          look=Look("speckle", 250, 200, 0.015, blur=0.7), force_noise=0.008, waits=20, elements=26),
    Study("h10", 79, "Gelatine block, glued, ultrasound", 50, 70,
          (Layer("gelatine", 35, 0.005),), alpha=2.0, poisson=0.49,
          control="force", compression=0.15, steps=6, pictured=(2, 4, 6), fitted=(2, 6),
          look=Look("blobs", 220, 170, 0.02, blur=0.5), force_noise=0.008, waits=20, elements=28, grading=4.0),
    Study("h11", 66, "Two-layer gel with dyed grains, photographed through a window", 24, 30,
          (Layer("upper", 8, 0.03), Layer("lower", 12, 0.04)), alpha=2.5, poisson=0.492,
          control="displacement", compression=0.0984, steps=6, pictured=(2, 4, 6), fitted=(2, 6),
          look=Look("cells", 180, 160, 0.015, whole=False), force_noise=0.006),
    Study("h12", 82, "Four-layer block on a held base with a lubricated plate", 30, 60,
          (Layer("w", 8, 0.05), Layer("x", 9, 0.02), Layer("y", 9, 0.06), Layer("z", 8, 0.03)), alpha=2.2, poisson=0.49,
          control="displacement", compression=0.125, steps=7, pictured=(2, 3, 5, 7), fitted=(2, 5, 7),
          look=Look("speckle", 180, 200, 0.005, level=200.0, whole=False), force_noise=0.005, indenter="slides",
          origin=(5, 2)),
    Study("h13", 81, "Three-layer block with fibrous texture, MRI", 40, 45,
          (Layer("p1", 11, 0.03), Layer("p2", 14, 0.015), Layer("p3", 13, 0.04)), alpha=3.0, poisson=0.492,
          control="force", compression=0.12, steps=6, pictured=(1, 2, 3, 4, 5, 6), fitted=(1, 3, 4, 6),
          look=Look("fibres", 230, 220, 0.01, magnitude=True), force_noise=0.003, elements=26, grading=4.0),
    Study("h14", 78, "Two-layer soft block, cell-like texture", 38, 30,
          (Layer("north", 16, 0.015), Layer("south", 18, 0.025)), alpha=2.0, poisson=0.49,
          control="force", compression=0.14, steps=8, pictured=(2, 4, 6, 7, 8), fitted=(2, 4, 6, 8),
          look=Look("cells", 200, 180, 0.012), force_noise=0.005, elements=20),
    Study("h15", 65, "Cast block of two silicones under a glued plate", 30, 50,
          (Layer("top", 10, 0.05), Layer("bottom", 14, 0.09)), alpha=2.0, poisson=0.49,
          control="force", compression=0.125, steps=6, pictured=(2, 3, 5, 6), fitted=(2, 5, 6),
          look=Look("blobs", 200, 170, 0.01), force_noise=0.005, waits=20),
    Study("h16", 67, "Two-layer block with pigment specks under a glued plate", 40, 60,
          (Layer("skin", 14, 0.06), Layer("core", 16, 0.035)), alpha=2.0, poisson=0.49,
          control="force", compression=0.11, steps=6, pictured=(1, 3, 4, 6), fitted=(1, 3, 6),
          look=Look("dark blobs", 220, 180, 0.01), force_noise=0.005, waits=20, elements=36, grading=1.0),
]
# fmt: on
