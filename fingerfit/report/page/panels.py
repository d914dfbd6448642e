"""All pictures of the page, each kept once, with the keys by which the page finds them."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from fingerfit.diagnosis.residual import BRIGHTNESS, DISPLACEMENT, RESPONSE
from fingerfit.imaging.sections import Slice
from fingerfit.report.page.edges import edge_figures
from fingerfit.report.page.figures import (
    Patches,
    brightness_panel,
    curve_panel,
    difference_panel,
    force_figure,
    grey_panel,
    map_frame,
    map_panel,
    stiffness_figure,
    stiffness_in_space,
)
from fingerfit.report.page.inputs import Compare, Model
from fingerfit.report.page.regions import patch_size
from fingerfit.report.page.sheets import Frame, Sheets, uri
from fingerfit.report.page.stiffness import field_figures
from fingerfit.report.page.views import View, cuts_at, cuts_of, views_of


class Panels:
    """Draws the pictures of all models to common scales.

    Parameters
    ----------
    models : list of Model
    before : Panels, optional
        Of another test: pictures are kept together.

    Attributes
    ----------
    uris : list of str
        Embedded pictures.
    keys : dict
        Number of a picture in `uris` by ``panel|model|picture``, ``there|model|picture|part`` or
        ``pattern|model|picture|effect``; of slices of volumes, ``picture@slice`` in place of the picture, and of
        curves by step, ``steps``; the curve beside that of an effect is ``there|model|steps|effect``.
    meshes : dict
        Outlines of the deformed mesh by model; of volumes, lines by ``picture@slice``.
    """

    def __init__(self, models: list[Model], before: Panels | None = None) -> None:
        self.uris: list[str] = before.uris if before else []
        self.keys: dict[str, int] = {}
        self.meshes: dict[str, Any] = {}
        self.frames: list[Frame] = []
        self.maps: list[dict[str, Any]] = []
        self.cuts: list[Slice] = []
        self._map_frames: list[Frame] = []
        self._sheets: Sheets = before._sheets if before else Sheets()
        self._known: dict[str, int] = before._known if before else {}
        self._owners: dict[str, np.ndarray] = {}
        self._greys: dict[tuple[bytes, float, int], int] = {}
        pictured = [m.compare for m in models if m.compare is not None and m.compare.pictures]
        self.top = (
            max((float(np.fmax(np.nanmax(c.measured), np.nanmax(c.synthesized))) for c in pictured), default=1.0) or 1.0
        )
        every = np.concatenate([np.abs(c.difference).ravel() for c in pictured]) if pictured else np.ones(1)
        self.limit = float(np.nanquantile(every, 0.999)) or 1.0
        self.reach = _limit(
            [m.compare.residual_displacement for m in models if m.compare is not None and m.compare.mapped]
        )
        for model in models:
            if model.compare is not None:
                self._draw(model, model.compare)

    def has(self, panel: str, model: str) -> bool:
        """Whether a model has such a picture."""
        return any(key == f"{panel}|{model}" or key.startswith(f"{panel}|{model}|") for key in self.keys)

    def keep(self, figure: Figure | str) -> int:
        """Number of a figure, or of one that is embedded already, among the embedded pictures."""
        text = figure if isinstance(figure, str) else uri(figure)
        if text not in self._known:
            self._known[text] = len(self.uris)
            self.uris.append(text)
        return self._known[text]

    def elements(self, model: Model, patches: list[int]) -> list[int]:
        """Elements of a model's mesh whose centres lie in patches."""
        owner = self._owners.get(model.name)
        return [] if owner is None else [int(n) for n in np.flatnonzero(np.isin(owner, patches))]

    def frame_data(self) -> list[dict[str, Any]]:
        """Where the axes of the pictures are, for what is laid over them; by slice, one of plane pictures."""
        return [_frame_data(frame) for frame in self.frames]

    def map_data(self) -> list[dict[str, Any]]:
        """Where the axes of the maps are, and the patches; by slice, one of plane pictures."""
        return self.maps

    def view_data(self) -> list[dict[str, str]]:
        """Names of the slices; none of plane pictures."""
        return [{"group": cut.name, "title": cut.title} for cut in self.cuts]

    def _draw(self, model: Model, compare: Compare) -> None:
        name = model.name
        # the same slices for all models
        self.cuts = self.cuts or cuts_of(compare)
        views: list[View | None] = [*views_of(compare, self.cuts)] if compare.volumes else [None]
        for number, view in enumerate(views):
            flat = compare if view is None else view.compare
            after = "" if view is None else f"@{number}"
            self._draw_pictures(name, flat, number, after)
            if flat.mapped:
                self._draw_maps(model, flat, number, after, view)
            if view is not None and any(view.lines):
                mesh = self.meshes.setdefault(name, {"names": [str(n) for n in compare.layer_names], "lines": {}})
                mesh["lines"] |= {f"{n}{after}": lines for n, lines in enumerate(view.lines)}
        if compare.mapped and len(model.stiffness):
            for n, figure in enumerate(_stiffness(compare, model.stiffness)):
                self.keys[f"stiffness|{name}|{n}"] = self.keep(figure)
        if len(compare.field_value) == len(compare.mesh_rings) > 0:
            for n, figure in enumerate(field_figures(compare)):
                self.keys[f"field|{name}|{n}"] = self.keep(figure)
        for edge, figure in edge_figures(compare).items():
            self.keys[f"edge|{name}|{edge}"] = self.keep(figure)
        if compare.meshed:
            self._keep_mesh(name, compare)
        self._draw_curves(model, compare)
        figure_or_none = force_figure(compare)
        if figure_or_none is not None:
            self.keys[f"force|{name}"] = self.keep(figure_or_none)

    def _draw_pictures(self, name: str, flat: Compare, number: int, after: str) -> None:
        if flat.pictures and len(self.frames) == number:
            self.frames.append(Frame.around(flat.limits, flat.axes))
        for n in range(flat.pictures):
            self.keys[f"measured|{name}|{n}{after}"] = self._grey(flat, flat.measured[n], number)
            self.keys[f"synthesized|{name}|{n}{after}"] = self._grey(flat, flat.synthesized[n], number)
            panel = difference_panel(self._sheets, self.frames[number], flat, flat.difference[n], self.limit)
            self.keys[f"difference|{name}|{n}{after}"] = self.keep(panel)

    def _grey(self, compare: Compare, values: np.ndarray, number: int) -> int:
        key = (np.ascontiguousarray(values).tobytes(), self.top, number)
        if key not in self._greys:
            self._greys[key] = self.keep(grey_panel(self._sheets, self.frames[number], compare, values, self.top))
        return self._greys[key]

    def _draw_maps(self, model: Model, compare: Compare, number: int, after: str, view: View | None) -> None:
        name = model.name
        if len(self.maps) == number:
            self._map_frames.append(map_frame(compare))
            self.maps.append(
                {
                    **_frame_data(self._map_frames[number]),
                    "centre": np.round(compare.patch_centre, 4).tolist(),
                    "patch": np.round(patch_size(compare), 4).tolist(),
                    "number": None if view is None else view.patches.tolist(),
                }
            )
        frame, patches = self._map_frames[number], Patches.of(compare)
        for n in range(compare.views):
            self.keys[f"map|{name}|{n}{after}"] = self.keep(
                map_panel(self._sheets, frame, patches, compare.residual_displacement[n], self.reach)
            )
        for part, panel in ((DISPLACEMENT, map_panel), (BRIGHTNESS, brightness_panel)):
            # of volumes one scale for all slices
            whole, drawn = getattr(model.compare, part), _drawn(model, part)
            own = _limit([whole])  # that of the residual: what an effect explains is compared with it
            for n in range(len(whole) if drawn else 0):
                drawing = panel(self._sheets, frame, patches, _in_plane(whole, view)[n], own)
                self.keys[f"there|{name}|{n}{after}|{part}"] = self.keep(drawing)
                for effect, values in drawn.items():
                    drawing = panel(self._sheets, frame, patches, _in_plane(values, view)[n], own)
                    self.keys[f"pattern|{name}|{n}{after}|{effect}"] = self.keep(drawing)

    def _draw_curves(self, model: Model, compare: Compare) -> None:
        """Residual by step, where there is no other or an effect is shown so, and what effects explain."""
        drawn = _drawn(model, RESPONSE)
        if not np.isfinite(compare.response).any() or (compare.views and not drawn):
            return
        left = compare.response
        if not compare.views:
            self.keys[f"there|{model.name}|steps|{RESPONSE}"] = self._keep_curve(compare, left, left)
        for effect, values in drawn.items():
            self.keys[f"there|{model.name}|steps|{effect}"] = self._keep_curve(compare, left, values)
            self.keys[f"pattern|{model.name}|steps|{effect}"] = self._keep_curve(compare, values, left)

    def _keep_curve(self, compare: Compare, values: np.ndarray, beside: np.ndarray) -> int:
        """A curve to the scale that it shares with the one beside it, and with the noise."""
        limit = 1.15 * float(np.nanmax(np.abs([values, beside, 2 * compare.response_noise]))) or 1.0
        return self.keep(curve_panel(compare, values, limit))

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


def _stiffness(compare: Compare, stiffness: np.ndarray) -> list[Figure]:
    if not compare.volumes:
        return [stiffness_figure(compare, stiffness)]
    cuts = cuts_at(compare, stiffness[:, 0])
    return stiffness_in_space([view.compare for view in views_of(compare, cuts)], stiffness)


def _drawn(model: Model, part: str) -> dict[str, np.ndarray]:
    """What effects explain of a part."""
    return {effect: values for effect, (own, values) in model.patterns.items() if own == part}


def _in_plane(values: np.ndarray, view: View | None) -> np.ndarray:
    """Displacements or brightness of the patches that are drawn, in the plane, shape (pictures, cells[, 2])."""
    if view is None:
        return values
    own = values[:, view.patches]
    return own[..., view.mains] if values.ndim == 3 else own


def _frame_data(frame: Frame) -> dict[str, Any]:
    return {"limits": frame.limits, "box": frame.box, "size": frame.size}


def _limit(values: list[np.ndarray]) -> float:
    """End of the scale of displacements or brightness: the greatest but for outliers, rounded up."""
    sizes = [np.linalg.norm(m, axis=-1) if m.ndim == 3 else np.abs(m) for m in values]
    lengths = np.concatenate([np.zeros(1), *(size.ravel() for size in sizes)])
    top = float(np.nanquantile(lengths, 0.995)) if np.isfinite(lengths).any() else 0.0
    if top <= 0:
        return 1e-3
    unit = 10.0 ** np.floor(np.log10(top))
    return float(next(step * unit for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if step * unit >= top * 0.999))
