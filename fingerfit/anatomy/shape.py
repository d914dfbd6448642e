"""Shape of a fingertip from a few numbers: skin, bones and nail as smooth functions.

The finger lies along x from the end section (x = 0, through the middle phalanx) to the tip; z points to the palmar
side, where the indenter comes from, and y across. Sizes of the reference are those of an adult's index finger.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from fingerfit.core.errors import InputError
from fingerfit.core.units import LENGTHS

NAIL_END = 1.5
"""mm between the nail's end and the tip."""


@dataclass(frozen=True)
class Anatomy:
    """Numbers of a finger, all in mm but for shares.

    Parameters
    ----------
    length : float
        From the end section to the tip.
    width : float
        Across, at the joint.
    palmar, dorsal : float
        Heights above and below the axis, at the joint.
    tip : float
        Length of the rounded end.
    taper : float
        Share by which the width falls from the joint to the beginning of the rounded end.
    slope : float
        Share by which the dorsal height falls on the same way.
    pulp : float
        Share by which the pulp is thicker than the palmar side at the joint.
    knuckle : float
        Share by which the joint is wider than the sections beside it.
    joint : float
        From the tip to the middle of the distal joint.
    gap : float
        Between the two phalanxes.
    bone_cover : float
        Tissue between the tip of the distal phalanx and the finger's.
    bone_width, bone_height : float
        Of the distal phalanx at its middle.
    bone_depth : float
        How far the phalanxes' axes are on the dorsal side of the finger's axis.
    nail_length, nail_angle : float
        Along the finger; half of the opening across, degrees. The nail ends 1.5 mm before the tip.
    epidermis, dermis : float
        Thickness of the layers; without dermis the subcutaneous tissue begins under the epidermis.

    Raises
    ------
    InputError
        For a number out of its bounds, or bones that do not fit into the finger.
    """

    length: float = 32.0
    width: float = 16.0
    palmar: float = 6.6
    dorsal: float = 5.8
    tip: float = 8.0
    taper: float = 0.10
    slope: float = 0.15
    pulp: float = 0.12
    knuckle: float = 0.05
    joint: float = 23.0
    gap: float = 1.2
    bone_cover: float = 4.0
    bone_width: float = 5.0
    bone_height: float = 3.8
    bone_depth: float = 1.6
    nail_length: float = 11.0
    nail_angle: float = 50.0
    epidermis: float = 0.6
    dermis: float = 0.0

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            positive = name not in ("dermis", "taper", "slope", "pulp", "knuckle")
            low, high = (0.0, np.inf) if positive or name == "dermis" else (-0.5, 0.5)
            if not np.isfinite(value) or value < low or value > high or (positive and value == 0):
                expected = "a positive number" if positive else f"a number from {low:g} to {high:g}"
                raise InputError("anatomy", name, value, expected)
            if high == np.inf and value > LENGTHS[1]:
                raise InputError("anatomy", name, value, f"at most {LENGTHS[1]:g}")
        if self.nail_angle > 90:
            raise InputError("anatomy", "nail_angle", self.nail_angle, "at most 90 degrees, the dorsal side")
        if self.nail_length > self.length - NAIL_END:
            expected = f"at most {self.length - NAIL_END:g} mm: it ends {NAIL_END:g} mm before the tip"
            raise InputError("anatomy", "nail_length", self.nail_length, expected)
        skin = self.epidermis + self.dermis
        free = min(
            (self.palmar + self.bone_depth - skin) / HEAD,
            (self.dorsal - self.bone_depth - skin) / HEAD,
            self.dorsal * (1 - self.slope) / (1 + self.knuckle) - self.bone_depth - skin,
        )
        if self.bone_height >= 2 * free:
            raise InputError("anatomy", "bone_height", self.bone_height, f"less than {2 * free:.3g} mm")
        if self.bone_width * HEAD / 2 + skin >= self.width / 2 * (1 - self.taper):
            raise InputError("anatomy", "bone_width", self.bone_width, "bones that fit into the width")
        if not self.tip < self.joint < self.length - 2 * self.gap:
            expected = f"between tip ({self.tip:g}) and {self.length - 2 * self.gap:g} mm"
            raise InputError("anatomy", "joint", self.joint, expected)
        if self.bone_cover < skin + 0.5:
            raise InputError("anatomy", "bone_cover", self.bone_cover, f"more than {skin + 0.5:g} mm")
        for distal, name in ((True, "bone_cover"), (False, "gap")):
            if bone_capsule(self, distal).straight <= 0:
                expected = f"less: the {'distal' if distal else 'middle'} phalanx is shorter than its ends are thick"
                raise InputError("anatomy", name, getattr(self, name), expected)

    @property
    def pulp_centre(self) -> float:
        """Where the pulp is thickest, and where an indenter comes down: x in mm."""
        return self.length - 1.15 * self.tip

    def sections(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Half width, palmar and dorsal height of the sections at `x` before the tip is rounded, all in mm."""
        centre = self.length - self.joint
        along = _smooth((x - centre) / (self.joint - self.tip))
        knuckle = 1 + self.knuckle * np.exp(-(((x - centre) / 4.0) ** 2))
        half = self.width / 2 / (1 + self.knuckle) * knuckle * (1 - self.taper * along)
        bulge = np.exp(-(((x - self.pulp_centre) / (0.45 * self.joint)) ** 2))
        palmar = self.palmar * (1 + self.pulp * bulge)
        dorsal = self.dorsal / (1 + self.knuckle) * knuckle * (1 - self.slope * along)
        return half, palmar, dorsal


HEAD = 1.25
"""Ends of the phalanxes over their middle, width and height."""


@dataclass(frozen=True)
class Capsule:
    """A cylinder of radius `radius` along x from 0 to `straight` with a half sphere at its end, and how it is mapped.

    Parameters
    ----------
    straight, radius : float
        Of the simple body that is meshed, mm.
    closed : bool
        With a half sphere at its beginning too, from -`radius` to 0.
    """

    straight: float
    radius: float
    closed: bool = False


def skin_capsule(anatomy: Anatomy) -> Capsule:
    """The simple body of the skin."""
    return Capsule(anatomy.length - anatomy.tip, (anatomy.width + anatomy.palmar + anatomy.dorsal) / 4)


def map_skin(anatomy: Anatomy, points: np.ndarray) -> np.ndarray:
    """The skin's surface, from points on its capsule; both of shape (points, 3)."""
    capsule = skin_capsule(anatomy)
    x = points[:, 0].copy()
    beyond = x > capsule.straight
    x[beyond] = capsule.straight + (x[beyond] - capsule.straight) * anatomy.tip / capsule.radius
    half, palmar, dorsal = anatomy.sections(x)
    y, z = points[:, 1] / capsule.radius, points[:, 2] / capsule.radius
    return np.stack([x, half * y, np.where(z > 0, palmar, dorsal) * z], axis=1)


def bone_capsule(anatomy: Anatomy, distal: bool) -> Capsule:
    """The simple body of a phalanx."""
    radius = (anatomy.bone_width + anatomy.bone_height) / 4 * HEAD
    start, end = _bone_ends(anatomy, distal)
    return Capsule(end - start - radius * (2 if distal else 1), radius, closed=distal)


def map_bone(anatomy: Anatomy, distal: bool, points: np.ndarray) -> np.ndarray:
    """A phalanx' surface, from points on its capsule; both of shape (points, 3)."""
    capsule = bone_capsule(anatomy, distal)
    start, end = _bone_ends(anatomy, distal)
    x = points[:, 0] + (start + capsule.radius if distal else start)
    share = (x - start) / (end - start)
    if distal:
        # base, waist and tuft; the tuft is wide and flat
        width = 1 + (HEAD - 1) * np.exp(-((share / 0.3) ** 2)) + 0.15 * np.exp(-(((share - 0.9) / 0.15) ** 2))
        width = width * (1 - 0.12 * share)
        height = 1 + (HEAD - 1) * np.exp(-((share / 0.3) ** 2)) - 0.25 * share
    else:
        width = height = 1 + (HEAD - 1) * np.exp(-(((x - end) / (0.3 * anatomy.joint)) ** 2))
    y = anatomy.bone_width / 2 * width * points[:, 1] / capsule.radius
    z = anatomy.bone_height / 2 * height * points[:, 2] / capsule.radius - anatomy.bone_depth
    return np.stack([x, y, z], axis=1)


def is_nail(anatomy: Anatomy, points: np.ndarray) -> np.ndarray:
    """Whether points on the skin, shape (points, 3), are on the nail."""
    end = anatomy.length - NAIL_END
    angle = np.degrees(np.arctan2(np.abs(points[:, 1]), -points[:, 2]))
    along = (points[:, 0] - (end - anatomy.nail_length / 2)) / (anatomy.nail_length / 2)
    # corners are rounded
    return (np.abs(along) ** 4 + (angle / anatomy.nail_angle) ** 4 < 1) & (points[:, 2] < 0)


def _bone_ends(anatomy: Anatomy, distal: bool) -> tuple[float, float]:
    middle = anatomy.length - anatomy.joint
    if distal:
        return middle + anatomy.gap / 2, anatomy.length - anatomy.bone_cover
    return 0.0, middle - anatomy.gap / 2


def _smooth(share: np.ndarray) -> np.ndarray:
    """Rises from 0 to 1 with level ends."""
    share = np.clip(share, 0.0, 1.0)
    return share**2 * (3 - 2 * share)
