"""Measured data as arrays, ready to be compared: what `prepare` writes and every round reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from fingerfit.core.errors import StateError
from fingerfit.core.files import read_npz, write_npz
from fingerfit.study.study import AXES


@dataclass(frozen=True)
class Data:
    """Measured data of a study in mm, N and s; NaN stands for what was not measured.

    Parameters
    ----------
    step : ndarray of int, shape (steps,)
        Numbers of the steps as the study gives them.
    force, displacement : ndarray, shape (steps,)
        Of the indenter, positive in compression, N and mm.
    control : str
        ``force`` or ``displacement``: what the simulation prescribes. The other one is data.
    force_noise : float or ndarray, shape (steps,)
        Standard deviation of the forces, N.
    displacement_noise, picture_noise, points_noise : float
        Standard deviations; that of the pictures holds before smoothing, in scaled intensity.
    before : ndarray, shape (ny, nx) or (nz, ny, nx)
        Smoothed and scaled picture before compression; empty when there are no pictures. Volumes are single precision.
    coefficients : ndarray, like `before`
        Cubic B-spline coefficients of the scaled picture before compression, not smoothed: that follows the warp.
    measured : ndarray, shape (pictures, ny, nx) or (pictures, nz, ny, nx)
        Smoothed and scaled pictures during compression.
    picture_step : ndarray of int, shape (pictures,)
        Index into `step` of each picture.
    spacing, origin, direction : ndarray
        Geometry of the pictures, mm.
    background : float
        Intensity where there is no body.
    smooth : float
        Standard deviation of the Gaussian that was applied, pixels.
    points, points_displacement : ndarray, shape (points, dim)
        Reference positions and measured displacements of material points, mm.
    points_step : ndarray of int, shape (points,)
        Index into `step` of each measured point.
    points_covariance : ndarray, shape (steps, steps)
        Of the error of a point at two steps, mm^2; `points_noise` is the root of its mean on the diagonal.
    frame_noise : float
        Standard deviation of a shift common to all points of a step, mm.
    force_gain : float
        Standard deviation of a factor common to all measured forces.
    history : str
        What was done to the pictures, in words, one step a line.
    outline : float
        How far at most the picture before compression surely shows a side of the body from where it is stated, mm.
    sides : ndarray, shape (4, 4) or (0, 4)
        How far out that picture shows each side, mm: Legendre coefficients along it, and their standard error.
    stated : ndarray, shape (2, 2) or (0, 2)
        Lower left and upper right corner of the body as it is stated, mm.
    blur : float
        Standard deviation of the blur of the camera, which does not move with the body, mm; 0 where none is known.
    remarks : str
        What looks wrong in the measurements and is no error, one a line.
    direction_of_load : ndarray, shape (dim,) or (0,)
        Unit vector along which `force` and `displacement` count; empty for straight down.
    lateral_force : ndarray, shape (steps, dim - 1) or (steps, 0)
        Measured forces of the indenter on the body along the other axes, N; their noise is that of the forces.
    response_scale : float
        Factor of the standard deviations of the response: above 1 where it is to count less.
    """

    step: np.ndarray
    force: np.ndarray
    displacement: np.ndarray
    control: str
    force_noise: float | np.ndarray
    displacement_noise: float
    picture_noise: float
    points_noise: float
    before: np.ndarray
    coefficients: np.ndarray
    measured: np.ndarray
    picture_step: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    background: float
    smooth: float
    points: np.ndarray
    points_displacement: np.ndarray
    points_step: np.ndarray
    points_covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    frame_noise: float = 0.0
    force_gain: float = 0.0
    history: str = ""
    outline: float = 0.0
    sides: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    stated: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    blur: float = 0.0
    remarks: str = ""
    direction_of_load: np.ndarray = field(default_factory=lambda: np.zeros(0))
    lateral_force: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    response_scale: float = 1.0

    def save(self, path: Path) -> None:
        """Write to .npz, whole or not at all; not compressed, because every round reads it and noise stays as large."""
        write_npz(path, {name: np.asarray(value) for name, value in self.__dict__.items()}, compressed=False)

    @classmethod
    def load(cls, path: Path) -> Data:
        """Read what `save` wrote.

        Raises
        ------
        StateError
            When the file is missing, damaged or something else.
        """
        arrays: dict[str, Any] = {k: v if v.ndim else v.item() for k, v in read_npz(path).items()}
        try:
            return cls(**arrays)
        except TypeError as error:
            raise StateError(f"{path}: is not prepared data: {error}") from error

    @property
    def control_noise(self) -> np.ndarray:
        """Standard deviation of the prescribed quantity, shape (steps,)."""
        return self._by_step(self.force_noise if self.control == "force" else self.displacement_noise)

    @property
    def controlled(self) -> np.ndarray:
        """Prescribed quantity per step, N or mm."""
        return self.force if self.control == "force" else self.displacement

    @property
    def control_share(self) -> np.ndarray:
        """Noise of the prescribed quantity as a share of it, shape (steps,); 0 where nothing is prescribed."""
        size = np.abs(self.controlled)
        return np.divide(self.control_noise, size, out=np.zeros_like(size), where=size > 0)

    @property
    def response(self) -> tuple[np.ndarray, np.ndarray]:
        """Measured quantities that the control leaves free, and their standard deviations, shapes (responses,).

        Of all steps the displacement or force along the load, then, axis by axis, the lateral forces.
        """
        forces = self._by_step(self.force_noise)
        along = (self.displacement, self._by_step(self.displacement_noise))
        measured, noise = along if self.control == "force" else (self.force, forces)
        lateral = self.lateral_force.T
        spread = np.concatenate([noise, *(forces for _ in lateral)])
        return np.concatenate([measured, lateral.ravel()]), self.response_scale * spread

    def split(self, response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Responses along the load, shape (steps,), and lateral forces, shape (steps, axes)."""
        count = len(self.step)
        return response[:count], response[count:].reshape(-1, count).T

    @property
    def response_step(self) -> np.ndarray:
        """Index of the step of each of these, shape (responses,)."""
        return np.tile(np.arange(len(self.step)), 1 + self.lateral_force.shape[1])

    def response_name(self, n: int) -> tuple[str, str]:
        """Name and unit of one of these."""
        axis = n // len(self.step)
        if axis:
            return f"force_{AXES[axis - 1]}", "N"
        return ("displacement", "mm") if self.control == "force" else ("force", "N")

    @property
    def between_steps(self) -> np.ndarray:
        """Covariance of a point's error at two steps, shape (steps, steps), mm^2."""
        if self.points_covariance.size:
            return self.points_covariance
        return self.points_noise**2 * np.eye(len(self.step))

    @property
    def entry_step(self) -> np.ndarray:
        """Index of the step of each field of displacements: of pictures, then of points."""
        return np.concatenate([self.picture_step, np.unique(self.points_step)]).astype(int)

    @property
    def response_gain(self) -> float:
        """Standard deviation of a factor common to all values of these."""
        return 0.0 if self.control == "force" else self.force_gain

    def _by_step(self, noise: float | np.ndarray) -> np.ndarray:
        return np.broadcast_to(np.asarray(noise, float), self.step.shape)
