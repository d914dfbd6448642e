"""Results of Ncorr and DuoDIC in MATLAB's files: arrays, structures and cells; nothing of them is run or unpickled."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import FingerfitError, InputError
from fingerfit.core.files import read_bytes

MOST = 2**30
"""Bytes of a file of MATLAB: Ncorr stores all pictures beside the displacements. A choice."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_MARK_AT = 512
"""Where MATLAB's files of version 7.3 have the mark of HDF5, after a head in text."""
_NCORR = ("plot_u_dic", "plot_v_dic", "plot_corrcoef_dic")
_NCORR_FORMATTED = ("plot_u_ref_formatted", "plot_v_ref_formatted")
_INFO = ("pixtounits", "units", "spacing", "type", "cutoff_corrcoef")
_WANTED = "results of Ncorr (data_dic_save) or DuoDIC (DIC3D or DIC3DPPresults)"

Fields = list[tuple[np.ndarray, np.ndarray]]
"""Places and displacements of each frame, NaN where nothing was correlated."""


def read_matlab(path: Path) -> tuple[str, str, Fields]:
    """Program, unit (empty: not known) and fields of all frames of a .mat file; y points downwards.

    Raises
    ------
    InputError
        For what is no such file, is damaged, or is of version 7.3 where h5py is not installed.
    """
    content = read_bytes(path, "file", MOST, "a file of MATLAB")
    new = content[:8] == _HDF5 or content[_MARK_AT : _MARK_AT + 8] == _HDF5
    try:
        found = _hdf5(path, content) if new else _version5(content)
        if "data_dic_save" in found:
            return "Ncorr", *_ncorr(path, found["data_dic_save"])
        for name in ("DIC3DPPresults", "DIC3D"):
            if name in found:
                return "DuoDIC", "mm", _duodic(path, found[name])
    except (FingerfitError, MemoryError):
        raise
    except Exception as error:  # scipy and h5py raise whatever a damaged file leads them to
        raise InputError(path, "file", f"a damaged file ({type(error).__name__})", _WANTED) from error
    raise InputError(path, "variables", ", ".join(sorted(found)) or "none", _WANTED)


def _version5(content: bytes) -> dict[str, Any]:
    """Variables of a file of version 5 to 7.2; structures as dicts, cells as lists."""
    from scipy.io import loadmat

    # the variables of interest alone: objects of classes stand in others
    names = ["data_dic_save", "DIC3D", "DIC3DPPresults"]
    found = loadmat(io.BytesIO(content), variable_names=names, simplify_cells=True)
    return {name: value for name, value in found.items() if not name.startswith("__")}


def _hdf5(path: Path, content: bytes) -> dict[str, Any]:
    """The same of version 7.3, of which only the named parts are read."""
    try:
        import h5py
    except ImportError:
        expected = "h5py (pip install h5py), or in MATLAB: load it, and save it with '-v7'"
        raise InputError(path, "file", "MATLAB's version 7.3", expected) from None
    with h5py.File(io.BytesIO(content), "r") as file:
        found: dict[str, Any] = {}
        if "data_dic_save" in file:
            group = file["data_dic_save"]
            parts = group["displacements"]
            fields = {name: _entries(file, parts[name]) for name in (*_NCORR, *_NCORR_FORMATTED) if name in parts}
            frames = [dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=True)]
            info = {name: _value(group["dispinfo"][name]) for name in _INFO if name in group["dispinfo"]}
            found["data_dic_save"] = {"displacements": frames, "dispinfo": info}
        for name in ("DIC3D", "DIC3DPPresults"):
            if name in file:
                group = file[name]
                found[name] = {key: _entries(file, group[key]) for key in ("Points3D", "corrComb") if key in group}
        return found or dict.fromkeys(file)


def _entries(file: Any, data: Any) -> list[np.ndarray]:
    """Arrays of a cell or of a field of several structures, in MATLAB's order of axes; of one structure, its own."""
    if data.dtype != object:
        return [_value(data)]
    return [_value(file[reference]) for reference in np.asarray(data).ravel()]


def _value(data: Any) -> Any:
    if data.attrs.get("MATLAB_empty", 0):
        return np.zeros((0, 0))
    if data.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.asarray(data).ravel()))
    return np.asarray(data).T


def _ncorr(path: Path, data: Any) -> tuple[str, Fields]:
    """Displacements with respect to the reference picture, on its reduced grid of pixels."""
    frames, info = data["displacements"], data["dispinfo"]
    frames = [frames] if isinstance(frames, dict) else list(frames)
    if "backward" in str(info.get("type", "")):
        expected = "one with displacements in the reference picture (type regular)"
        raise InputError(path, "dispinfo.type", "backward", expected)
    step = _number(path, info, "spacing") + 1.0
    formatted = all(np.size(frame.get(name, ())) for frame in frames for name in _NCORR_FORMATTED)
    size = _number(path, info, "pixtounits") if formatted else 1.0
    names = _NCORR_FORMATTED if formatted else _NCORR[:2]
    limits = np.broadcast_to(np.ravel(info["cutoff_corrcoef"]), len(frames)) if formatted else [np.inf] * len(frames)
    unit = str(info.get("units") or "") if formatted else "pixel"
    found = []
    for number, (frame, limit) in enumerate(zip(frames, limits, strict=True), 1):
        u, v, quality = (np.atleast_2d(frame[name]) for name in (*names, _NCORR[2]))
        if not u.size or u.shape != v.shape or u.shape != quality.shape:
            shapes = ", ".join(" x ".join(map(str, one.shape)) for one in (u, v, quality))
            raise InputError(path, f"displacements({number})", shapes, "three arrays of one shape")
        rows, columns = np.nonzero(quality)  # 0 where there is nothing, as outside of the region of interest
        places = np.stack([columns, rows], axis=1) * step * size
        moved = np.stack([u[rows, columns], v[rows, columns]], axis=1).astype(float)
        moved[quality[rows, columns] > limit] = np.nan
        found.append((places, moved))
    return unit, found


def _number(path: Path, info: Any, name: str) -> float:
    value = np.ravel(info.get(name, ()))
    if value.size != 1 or not np.isfinite(value).all():
        raise InputError(path, f"dispinfo.{name}", "nothing" if not value.size else value, "one number")
    return float(value[0])


def _duodic(path: Path, data: Any) -> Fields:
    """Points in space at each frame; displacements are from the first one."""
    points = _cells(data.get("Points3D", ()))
    if len(points) < 2:
        raise InputError(path, "Points3D", f"{len(points)} frames", "at least 2: the first is the reference")
    if any(one.ndim != 2 or one.shape != (len(points[0]), 3) for one in points):
        raise InputError(path, "Points3D", "arrays of different shapes", "three coordinates of the same points in each")
    first = points[0]
    kept = np.isfinite(first).all(axis=1)
    return [(first[kept], (one - first)[kept]) for one in points]


def _cells(value: Any) -> Sequence[np.ndarray]:
    several = isinstance(value, (list, tuple)) or np.ndim(value) != 2
    return [np.asarray(one, float) for one in (value if several else [value])]
