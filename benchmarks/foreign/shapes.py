"""Bodies that are no rectangles: where each place of the rectangle lies, and mesh files of such bodies.

What is here is known to the study, as its mesh; a hidden outline or interface (effects.py) comes before it.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

SHAPES = ("barrel", "waisted", "trapezoid", "skewed", "domed")
"""Sides that bulge or draw in, a narrower top, a top that lies aside, a base and layers that are arched."""
MESHES = {"mesh": (9, 2.0), "refined": (15, 2.0)}
"""Rows of elements, and how much longer those in the middle are than those at the glued ends."""


def placed(setting: Mapping[str, Any], x: Any, y: Any) -> tuple[Any, Any]:
    """Where a place of the rectangle lies in the body, mm; a rectangle without a `shape`."""
    shape = setting.get("shape")
    width, height = setting["width"], float(sum(setting["heights"]))
    t, centred = y / height, x - width / 2
    if shape is None:
        return x, y
    if shape == "skewed":
        return x + 0.25 * height * (t - 0.5), y
    if shape == "domed":
        s = 2 * centred / width
        return x, y + 0.12 * height * (1 - t) * (1 - s * s)
    factor = {"barrel": 0.5 * t * (1 - t), "waisted": -0.5 * t * (1 - t), "trapezoid": 0.3 * (0.5 - t)}[shape]
    return width / 2 + centred * (1 + factor), y


def write_mesh(path: Path, setting: Mapping[str, Any], rows: int, ratio: float) -> None:
    """Write quadratic quadrilaterals (CPE8H), nodes on the body's true outline, with sets of layers and sides."""
    levels = np.concatenate([[0.0], np.cumsum(setting["heights"][::-1])])
    up = _lines(levels, rows, ratio)
    layer = np.searchsorted(levels, (up[:-1] + up[1:]) / 2) - 1
    long = round(rows * setting["width"] / levels[-1])
    across = _lines(np.array([0.0, setting["width"]]), long, ratio)
    numbers: dict[tuple[int, int], int] = {}
    lines = ["*NODE"]
    for j in range(2 * rows_of(up) + 1):
        for i in range(2 * rows_of(across) + 1):
            if i % 2 and j % 2:
                continue
            numbers[i, j] = len(numbers) + 1
            x, y = placed(setting, _halfway(across, i), _halfway(up, j))
            lines.append(f"{numbers[i, j]}, {x:.8f}, {y:.8f}")
    elements: dict[str, list[int]] = {}
    lines.append("*ELEMENT, TYPE=CPE8H")
    count = 0
    names = setting["names"][::-1]
    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    for j in range(rows_of(up)):
        for i in range(rows_of(across)):
            count += 1
            elements.setdefault(names[layer[j]].upper(), []).append(count)
            corners = (str(numbers[2 * i + a, 2 * j + b]) for a, b in around)
            lines.append(f"{count}, {', '.join(corners)}")
    for name, members in elements.items():
        lines += [f"*ELSET, ELSET={name}", *_in_rows(members)]
    last_i, last_j = 2 * rows_of(across), 2 * rows_of(up)
    sides = {
        "BOTTOM": [n for (i, j), n in numbers.items() if j == 0],
        "TOP": [n for (i, j), n in numbers.items() if j == last_j],
        "LEFT": [n for (i, j), n in numbers.items() if i == 0],
        "RIGHT": [n for (i, j), n in numbers.items() if i == last_i],
    }
    for name, members in sides.items():
        lines += [f"*NSET, NSET={name}", *_in_rows(members)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def rows_of(lines: np.ndarray) -> int:
    """Elements between lines."""
    return len(lines) - 1


def _lines(levels: np.ndarray, count: int, ratio: float) -> np.ndarray:
    """About as many steps as `count` from first to last level, through all levels, shorter towards both ends."""
    g = np.arccosh(np.sqrt(ratio))

    def graded(t: np.ndarray) -> np.ndarray:
        return 0.5 * (1 + np.tanh(g * (2 * t - 1)) / np.tanh(g))

    def steady(s: np.ndarray) -> np.ndarray:
        return 0.5 * (1 + np.arctanh(np.clip(2 * s - 1, -1, 1) * np.tanh(g)) / g)

    ends = steady(levels / levels[-1])
    found = [0.0]
    for low, high in itertools.pairwise(ends):
        steps = max(2, round(count * (high - low)))
        found += list(levels[-1] * graded(np.linspace(low, high, steps + 1)[1:]))
    return np.array(found)


def _halfway(lines: np.ndarray, index: int) -> float:
    """Place of a line, or half-way to the next one for an odd index."""
    low = lines[index // 2]
    return float(low if index % 2 == 0 else (low + lines[index // 2 + 1]) / 2)


def _in_rows(members: list[int]) -> list[str]:
    return [", ".join(str(n) for n in members[k : k + 12]) for k in range(0, len(members), 12)]
