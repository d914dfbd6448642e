"""The table of the studies: bodies, tests, textures and noise. Lengths in mm, forces in N, moduli in MPa."""

from __future__ import annotations

from dataclasses import dataclass


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
    kind : str
        Texture: cloud, modes, dots or strands.
    size : float
        Size of its spots, pixels.
    contrast : float
        Standard deviation of the texture over its mean.
    pixel : float
        Side of a pixel, mm.
    blur : float
        Standard deviation of the blur in the picture, pixels.
    mean : float
        Mean intensity of the body.
    levels : tuple of float or None
        Factor of the intensity of each layer, from the base on.
    """

    kind: str
    size: float
    contrast: float
    pixel: float
    blur: float
    mean: float
    levels: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Noise:
    """Standard deviations.

    Parameters
    ----------
    picture : float
        Over the mean intensity of the body.
    force : float
        Over the largest force.
    displacement : float
        In pixels.
    magnitude : bool
        Whether the pictures have magnitude noise (Rician) on zero, else Gaussian noise on a black level.
    """

    picture: float
    force: float
    displacement: float
    magnitude: bool = False


@dataclass(frozen=True)
class Study:
    """A compression test.

    Parameters
    ----------
    name, title : str
        Name of the folder, and what the test is.
    width, thickness : float
        Of the body, mm.
    layers : tuple of Layer
        From the base to the plate.
    alpha, poisson : float
        Exponent of the law and Poisson ratio, alike in all layers.
    control : str
        What is prescribed: displacement or force.
    steps : int
        Number of steps.
    compression : float
        Largest indentation over the height.
    look, noise : Look, Noise
        Of the pictures and of what is measured.
    origin : tuple of float
        Place of the body's lower left corner, mm.
    elements : int
        Elements along the side of a square as large as the body.
    """

    name: str
    title: str
    width: float
    layers: tuple[Layer, ...]
    thickness: float
    alpha: float
    poisson: float
    control: str
    steps: int
    compression: float
    look: Look
    noise: Noise
    origin: tuple[float, float] = (0, 0)
    elements: int = 20

    @property
    def number(self) -> int:
        """Number in the name; all seeds come from it."""
        return int(self.name[1:])

    @property
    def seed(self) -> int:
        """Seed of the steps and of the texture."""
        return self.number + 100

    @property
    def heights(self) -> list[float]:
        """Heights of the layers, from the base on."""
        return [layer.height for layer in self.layers]

    @property
    def height(self) -> float:
        """Height of the body."""
        return sum(self.heights)


# fmt: off
STUDIES = [
    Study("w01", "Small gel pad", 10, (Layer("gel", 8, 0.0187),), thickness=45, alpha=4.0, poisson=0.49,
          control="displacement", steps=6, compression=0.20,
          look=Look("modes", 1.7, 0.22, pixel=0.078, blur=0.9, mean=2200),
          noise=Noise(0.016, 0.003, 0.05, magnitude=True)),
    Study("w02", "Soft sheet on a gel", 20, (Layer("pad", 9, 0.012), Layer("sheet", 7, 0.031)),
          thickness=100, alpha=3.0, poisson=0.49, control="force", steps=6, compression=0.17,
          look=Look("dots", 2.0, 0.28, pixel=0.15, blur=0.8, mean=9000, levels=(1.0, 0.8)),
          noise=Noise(0.014, 0.003, 0.06)),
    Study("w03", "Two silicones, wide plate", 30, (Layer("lower", 14, 0.045), Layer("upper", 10, 0.021)),
          thickness=150, alpha=5.0, poisson=0.49, control="displacement", steps=7, compression=0.16,
          look=Look("cloud", 1.6, 0.25, pixel=0.2, blur=1.0, mean=3100),
          noise=Noise(0.018, 0.003, 0.05), origin=(5, 2)),
    Study("w04", "Three layers of agar", 24,
          (Layer("bottom", 8, 0.062), Layer("middle", 9, 0.014), Layer("top", 7, 0.033)),
          thickness=120, alpha=4.0, poisson=0.492, control="force", steps=7, compression=0.19,
          look=Look("cloud", 1.5, 0.2, pixel=0.19, blur=0.8, mean=12000, levels=(1.0, 1.25, 0.85)),
          noise=Noise(0.02, 0.004, 0.07)),
    Study("w05", "Gel with a softer cover", 16, (Layer("base", 6, 0.025), Layer("cover", 8, 0.0105)),
          thickness=80, alpha=4.0, poisson=0.49, control="force", steps=5, compression=0.19,
          look=Look("dots", 1.9, 0.25, pixel=0.125, blur=0.7, mean=20000, levels=(1.0, 0.9)),
          noise=Noise(0.008, 0.0025, 0.05)),
    Study("w06", "Cast block of two mixtures", 20, (Layer("hard", 9, 0.083), Layer("soft", 11, 0.037)),
          thickness=90, alpha=5.0, poisson=0.485, control="displacement", steps=6, compression=0.17,
          look=Look("modes", 1.9, 0.2, pixel=0.16, blur=0.9, mean=2600),
          noise=Noise(0.015, 0.003, 0.05)),
    Study("w07", "Large specimen of four layers", 60,
          (Layer("d", 10, 0.094), Layer("c", 10, 0.038), Layer("b", 12, 0.071), Layer("a", 8, 0.022)),
          thickness=260, alpha=4.0, poisson=0.49, control="force", steps=8, compression=0.15,
          look=Look("strands", 1.8, 0.2, pixel=0.42, blur=0.8, mean=8000, levels=(1.0, 1.2, 0.9, 1.1)),
          noise=Noise(0.015, 0.003, 0.05, magnitude=True)),
    Study("w08", "Two foils of urethane", 25, (Layer("under", 11, 0.052), Layer("over", 9, 0.024)),
          thickness=110, alpha=4.0, poisson=0.488, control="displacement", steps=7, compression=0.19,
          look=Look("cloud", 1.8, 0.22, pixel=0.19, blur=1.0, mean=4000, levels=(1.0, 1.15)),
          noise=Noise(0.014, 0.004, 0.05)),
    Study("w09", "Single block", 18, (Layer("body", 15, 0.0293),), thickness=90, alpha=4.0, poisson=0.49,
          control="displacement", steps=6, compression=0.17,
          look=Look("modes", 1.8, 0.24, pixel=0.14, blur=0.8, mean=15000),
          noise=Noise(0.02, 0.003, 0.05, magnitude=True)),
    Study("w10", "Hydrogel cube", 12, (Layer("gel", 12, 0.0088),), thickness=60, alpha=3.0, poisson=0.49,
          control="displacement", steps=7, compression=0.20,
          look=Look("cloud", 1.5, 0.24, pixel=0.1, blur=0.9, mean=2900),
          noise=Noise(0.017, 0.004, 0.05)),
    Study("w11", "Flat slab of two layers", 40, (Layer("lower", 13, 0.017), Layer("upper", 12, 0.044)),
          thickness=200, alpha=6.0, poisson=0.49, control="displacement", steps=5, compression=0.14,
          look=Look("dots", 2.1, 0.26, pixel=0.27, blur=1.0, mean=6000),
          noise=Noise(0.018, 0.003, 0.06)),
    Study("w12", "Soft over stiff rubber", 24, (Layer("stiff", 9, 0.118), Layer("soft", 11, 0.029)),
          thickness=100, alpha=4.0, poisson=0.49, control="force", steps=7, compression=0.17,
          look=Look("strands", 1.7, 0.22, pixel=0.17, blur=0.8, mean=10000),
          noise=Noise(0.015, 0.003, 0.05)),
    Study("w13", "Three layers in a small press", 15,
          (Layer("bottom", 5, 0.041), Layer("middle", 5.5, 0.0165), Layer("top", 4.5, 0.028)),
          thickness=75, alpha=4.0, poisson=0.49, control="force", steps=6, compression=0.16,
          look=Look("cloud", 1.6, 0.23, pixel=0.115, blur=0.8, mean=5200, levels=(1.0, 0.8, 1.15)),
          noise=Noise(0.016, 0.003, 0.05, magnitude=True)),
    Study("w14", "Two layers of rubber", 30, (Layer("low", 12, 0.048), Layer("high", 10, 0.023)),
          thickness=130, alpha=6.0, poisson=0.49, control="force", steps=6, compression=0.14,
          look=Look("modes", 2.0, 0.23, pixel=0.21, blur=0.9, mean=7000),
          noise=Noise(0.016, 0.003, 0.05), elements=16),
    Study("w15", "Tall layered block", 50,
          (Layer("bottom", 15, 0.036), Layer("core", 18, 0.0115), Layer("top", 12, 0.061)),
          thickness=220, alpha=3.0, poisson=0.488, control="displacement", steps=8, compression=0.18,
          look=Look("modes", 1.6, 0.2, pixel=0.36, blur=0.8, mean=3300, levels=(1.0, 1.2, 0.9)),
          noise=Noise(0.02, 0.003, 0.05)),
    Study("w16", "Gelatine block", 20, (Layer("gelatine", 18, 0.0135),), thickness=100, alpha=4.0, poisson=0.49,
          control="force", steps=7, compression=0.17,
          look=Look("cloud", 1.8, 0.24, pixel=0.155, blur=0.9, mean=11000),
          noise=Noise(0.014, 0.003, 0.05)),
]
# fmt: on
