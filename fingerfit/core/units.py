"""Units that a study may use, and their size in mm, N and s."""

from __future__ import annotations

UNITS: dict[str, dict[str, float]] = {
    "length": {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3},
    "force": {"mN": 1e-3, "N": 1.0, "kN": 1e3, "gf": 9.80665e-3, "kgf": 9.80665},
    "time": {"ms": 1e-3, "s": 1.0, "min": 60.0},
}

LENGTHS = (1e-6, 1e6)
"""mm that a length of a body or picture has: from a nanometre, where bodies are atoms, to a kilometre."""
