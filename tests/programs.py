"""Displacements of points and a record of a machine as other programs write them (docs/readers.md)."""

import csv
import io

import numpy as np

X, Y = (grid.ravel() for grid in np.meshgrid(np.arange(5.0), np.arange(4.0)))
"""20 places, in the unit of the file."""
FRAMES = 3


def field(frame):
    """Displacements of the places: wider along x and shorter along y from frame to frame."""
    return 0.01 * frame * X, -0.02 * frame * Y


def text(head, columns, delimiter=",", above="", quoted=False):
    out = io.StringIO()
    writer = csv.writer(out, delimiter=delimiter, quoting=csv.QUOTE_NONNUMERIC if quoted else csv.QUOTE_MINIMAL)
    writer.writerow(head)
    writer.writerows([[float(f"{value:.6g}") for value in row] for row in np.stack(columns, axis=1)])
    return above + out.getvalue()


def vic3d(n):
    u, v = field(n)
    return text(
        ["X", "Y", "Z", "U", "V", "W", "exx", "sigma"],
        [X, Y, 0 * X + 0.01, u, v, 0 * u, 0 * u, 0 * u + 0.01],
        quoted=True,
    )


def vic2d(n):
    u, v = field(n)
    return text(["x", "y", "u", "v", "sigma", "x_c", "y_c", "u_c", "v_c", "exx"],
                [20 * X, 20 * Y, 20 * u, 20 * v, 0 * u + 0.01, X, Y, u, v, 0 * u])  # fmt: skip


def matchid(n):
    u, v = field(n)
    head = ["Coordinates.Image X [Pixel]", "Coordinates.Image Y [Pixel]", "coor.X [mm]", "coor.Y [mm]",
            "disp.Horizontal Displacement U [mm]", "disp.Vertical Displacement V [mm]", "strain.Strain-global frame: Exx [ ]"]  # fmt: skip
    return text(head, [20 * X, 20 * Y, X, -Y, u, -v, 0 * u])


def dice(n):
    u, v = field(n)
    above = "***\n*** Digital Image Correlation Engine (DICe)\n*** Subset size: 27\n***\n"
    return text(["SUBSET_ID", "COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X", "DISPLACEMENT_Y", "SIGMA", "GAMMA", "MATCH"],
                [np.arange(20), 20 * X, -20 * Y, 20 * u, -20 * v, 0 * u + 0.01, 0 * u, 0 * u], above=above)  # fmt: skip


def pyvale(n):
    u, v = field(n)
    return text(["subset_x", "subset_y", "disp_u", "disp_v", "disp_mag", "converged", "cost_zncc", "ftol", "xtol", "num_iter"],
                [20 * X, -20 * Y, 20 * u, -20 * v, 0 * u, 0 * u + 1, 0 * u, 0 * u, 0 * u, 0 * u + 5])  # fmt: skip


def plain(n):
    """As a spreadsheet in Germany writes it."""
    u, v = field(n)
    return text(["x [um]", "y [um]", "ux [um]", "uy [um]"], [1000 * X, 1000 * Y, 1000 * u, 1000 * v], ";").replace(
        ".", ","
    )


PROGRAMS = {"VIC-3D": (vic3d, None), "VIC-2D": (vic2d, None), "MatchID": (matchid, None), "DICe": (dice, 0.05),
            "pyvale": (pyvale, 0.05), "plain": (plain, None)}  # fmt: skip
"""By name: a frame as text, and mm of a pixel."""


def write(folder, program):
    paths = [folder / f"frame_{n}.csv" for n in range(FRAMES)]
    for n, path in enumerate(paths):
        path.write_text(PROGRAMS[program][0](n), encoding="utf-8")
    return paths


INSTRON = '"Specimen","1"\n\n"Time","Extension","Load"\n"(s)","(mm)","(N)"\n' + "".join(
    f'"{n / 10:.3f}","{0.02 * n:.4f}","{0.5 * n:.3f}"\n' for n in range(20)
)
