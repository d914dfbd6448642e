"""All pictures of the page, each kept once, with the keys by which the page finds them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fingerfit.page.figures import (
    Frame,
    difference_panel,
    force_figure,
    grey_panel,
    map_frame,
    map_panel,
    stiffness_figure,
    uri,
)
from fingerfit.page.inputs import Compare, Model
from fingerfit.page.regions import patch_size

PATTERNS = 4
"""Effects of a model whose patterns are drawn."""


class Panels:
    """Draws the pictures of all models to common scales.

    Parameters
    ----------
    models : list of Model

    Attributes
    ----------
    uris : list of str
        Embedded pictures.
    keys : dict
        Number of a picture in `uris` by ``panel|model|picture`` or ``pattern|model|picture|effect``.
    meshes : dict
        Outlines of the deformed mesh by model.
    """

    def __init__(self, models: list[Model]) -> None:
        self.uris: list[str] = []
        self.keys: dict[str, int] = {}
        self.meshes: dict[str, Any] = {}
        self.frame: Frame | None = None
        self.maps: Frame | None = None
        self._known: dict[str, int] = {}
        self._owners: dict[str, np.ndarray] = {}
        self._greys: dict[tuple[bytes, float], int] = {}
        pictured = [m.compare for m in models if m.compare is not None and m.compare.pictures]
        self.top = (
            max((float(np.fmax(np.nanmax(c.measured), np.nanmax(c.synthesized))) for c in pictured), default=1.0) or 1.0
        )
        every = np.concatenate([np.abs(c.difference).ravel() for c in pictured]) if pictured else np.ones(1)
        self.limit = float(np.nanquantile(every, 0.999)) or 1.0
        self.reach = _limit([c.moves for c in pictured if c.mapped])
        for model in models:
            if model.compare is not None:
                self._draw(model, model.compare)

    def has(self, panel: str, model: str) -> bool:
        """Whether a model has such a picture."""
        return any(key == f"{panel}|{model}" or key.startswith(f"{panel}|{model}|") for key in self.keys)

    def keep(self, figure: Figure) -> int:
        """Number of a figure among the embedded pictures."""
        text = uri(figure)
        if text not in self._known:
            self._known[text] = len(self.uris)
            self.uris.append(text)
        return self._known[text]

    def elements(self, model: Model, patches: list[int]) -> list[int]:
        """Elements of a model's mesh whose centres lie in patches."""
        owner = self._owners.get(model.name)
        return [] if owner is None else [int(n) for n in np.flatnonzero(np.isin(owner, patches))]

    def frame_data(self) -> dict[str, Any] | None:
        """Where the axes of the pictures are, for what is laid over them."""
        return _frame_data(self.frame)

    def map_data(self) -> dict[str, Any] | None:
        """Where the axes of the maps are, and the patches."""
        found = _frame_data(self.maps)
        return None if found is None else {**found, "centre": self._centres, "patch": self._size}

    def _draw(self, model: Model, compare: Compare) -> None:
        name = model.name
        if compare.pictures:
            self.frame = self.frame or Frame.around(compare.limits)
        for n in range(compare.pictures):
            self.keys[f"measured|{name}|{n}"] = self._grey(compare, compare.measured[n])
            self.keys[f"synthesized|{name}|{n}"] = self._grey(compare, compare.synthesized[n])
            assert self.frame is not None
            figure = difference_panel(self.frame, compare, compare.difference[n], self.limit)
            self.keys[f"difference|{name}|{n}"] = self.keep(figure)
        if compare.mapped:
            self._draw_maps(model, compare)
        if compare.mapped and len(model.stiffness):
            self.keys[f"stiffness|{name}"] = self.keep(stiffness_figure(compare, model.stiffness))
        if compare.meshed:
            self._keep_mesh(name, compare)
        figure_or_none = force_figure(compare)
        if figure_or_none is not None:
            self.keys[f"force|{name}"] = self.keep(figure_or_none)

    def _grey(self, compare: Compare, values: np.ndarray) -> int:
        assert self.frame is not None
        key = (np.ascontiguousarray(values).tobytes(), self.top)
        if key not in self._greys:
            self._greys[key] = self.keep(grey_panel(self.frame, compare, values, self.top))
        return self._greys[key]

    def _draw_maps(self, model: Model, compare: Compare) -> None:
        name = model.name
        if self.maps is None:
            self.maps = map_frame(compare)
            self._centres = np.round(compare.patch_centre, 4).tolist()
            self._size = np.round(patch_size(compare), 4).tolist()
        ranked = [str(entry.get("effect")) for entry in model.diagnosis.get("ranking") or []]
        drawn = [effect for effect in ranked if effect in model.patterns][:PATTERNS]
        there = compare.moves if model.there is None else model.there
        own = _limit([there, *(model.patterns[effect] for effect in drawn)])
        for n in range(compare.pictures):
            self.keys[f"map|{name}|{n}"] = self.keep(map_panel(self.maps, compare, compare.moves[n], self.reach))
            if not drawn:
                continue
            self.keys[f"there|{name}|{n}"] = self.keep(map_panel(self.maps, compare, there[n], own))
            for effect in drawn:
                figure = map_panel(self.maps, compare, model.patterns[effect][n], own)
                self.keys[f"pattern|{name}|{n}|{effect}"] = self.keep(figure)

    def _keep_mesh(self, name: str, compare: Compare) -> None:
        rings = [[int(i) for i in ring if i >= 0] for ring in compare.mesh_rings]
        self.meshes[name] = {
            "rings": rings,
            "layer": [int(n) for n in compare.mesh_layer],
            "names": [str(n) for n in compare.layer_names],
            "moved": [np.round(moved, 3).tolist() for moved in compare.mesh_moved],
        }
        if compare.mapped:
            size = patch_size(compare)
            low = compare.patch_centre.min(axis=0) - size / 2
            centres = np.array([compare.mesh_points[ring].mean(axis=0) for ring in rings])
            index = np.clip(np.floor((centres - low) / size).astype(int), 0, compare.patch_count - 1)
            self._owners[name] = index[:, 0] * int(compare.patch_count[1]) + index[:, 1]


def _frame_data(frame: Frame | None) -> dict[str, Any] | None:
    return None if frame is None else {"limits": frame.limits, "box": frame.box, "size": frame.size}


def _limit(moves: list[np.ndarray]) -> float:
    """End of the scale of displacements: the greatest but for a few outliers, rounded up, mm."""
    lengths = np.concatenate([np.zeros(1), *(np.hypot(m[..., 0], m[..., 1]).ravel() for m in moves)])
    top = float(np.nanquantile(lengths, 0.995)) if np.isfinite(lengths).any() else 0.0
    if top <= 0:
        return 1e-3
    unit = 10.0 ** np.floor(np.log10(top))
    return float(next(step * unit for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * unit >= top * 0.999))
