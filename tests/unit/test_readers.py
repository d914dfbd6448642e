"""Files of other programs, made by hand as their documentation has them (docs/readers.md), whole and damaged."""

import re

import numpy as np
import pytest
from programs import FRAMES, INSTRON, PROGRAMS, X, Y, field, vic3d, write
from scipy.io import savemat
from seeds import generator as seeded

from fingerfit.core.errors import InputError
from fingerfit.readers.machine import ramps, read_machine
from fingerfit.readers.matlab import read_matlab
from fingerfit.readers.points import common, in_mm, outliers, plane, read_points, turned
from fingerfit.readers.tables import read_head, read_table


def same(record, scale):
    """Whether a record is the field."""
    record = plane(in_mm(record, None, scale, "here"), None)
    places, moved, told = common(record, range(1, len(record.names)))
    order = np.lexsort(turned(places, "y", record.down).T)
    assert turned(places, "y", record.down)[order] == pytest.approx(np.stack([X, Y], axis=1), abs=1e-9)
    for n, one in enumerate(moved, 1):
        assert turned(one, "y", record.down)[order] == pytest.approx(np.stack(field(n), axis=1), abs=1e-6)
    return told


@pytest.mark.parametrize("program", PROGRAMS)
def test_each_program_gives_the_field(tmp_path, program):
    record = read_points(write(tmp_path, program))
    assert record.program == program
    assert same(record, PROGRAMS[program][1]) == ()


def damaged(content, how):
    """A text with one damage; a table's parts are the lines above its numbers and its rows of cells."""
    lines = content.splitlines()
    first = next(n for n, line in enumerate(lines) if re.match(r'"?-?[0-9]', line))
    mark = ";" if ";" in lines[-1] else ","
    above, rows = lines[:first], [line.split(mark) for line in lines[first:]]
    # the first horizontal displacement that is used
    head = [cell.strip('"') for cell in above[-1].split(mark)]
    u = next(n for n, cell in enumerate(head) if re.match(r"U$|u_c|disp.*U |DISPLACEMENT_X|disp_u|ux", cell))
    if how == "empty":
        above, rows = [], []
    elif how == "names alone":
        rows = []
    elif how == "cut":
        rows[-1] = rows[-1][:-1]
    elif how == "a cell too many":
        rows[5].append("1")
    elif how == "a word":
        rows[3][u] = "lost"
    elif how == "two marks":
        rows[3][u] = "1.2.3"
    elif how == "all lost":
        rows = [[*row[:u], "", *row[u + 1 :]] for row in rows]
    elif how == "another name":
        above[-1] = above[-1].replace(head[u], "speckle")
    elif how == "no names":
        above = []
    text = "\n".join([*above, *(mark.join(row) for row in rows)])
    return "PK\x03\0" + text if how == "binary" else text + "\n"


DAMAGES = {
    "empty": "fewer than 2 rows of numbers; expected a table",
    "names alone": "fewer than 2 rows of numbers; expected a table",
    "cut": r"line \d+: found \d+ cells; expected \d+, as in line",
    "a cell too many": r"line \d+: found \d+ cells; expected \d+, as in line",
    "a word": "line .*: found lost; expected a number",
    "two marks": r"line .*: found 1\.2\.3; expected a number",
    "all lost": "points: found 0 with a displacement; expected at least 9",
    "another name": "columns: found .*speckle.*; expected .*, as frame_0.csv",
    "no names": "columns: found no names above .*; expected .*, as frame_0.csv",
    "binary": "points: found a binary file; expected a table in text",
}


@pytest.mark.parametrize("how", DAMAGES)
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_damaged_table_is_one_line(tmp_path, program, how):
    path = write(tmp_path, program)[1]
    path.write_text(damaged(path.read_text(encoding="utf-8"), how), encoding="utf-8")
    with pytest.raises(InputError, match=DAMAGES[how]) as found:
        read_points(sorted(tmp_path.iterdir()))
    assert "\n" not in str(found.value)
    assert str(path) in str(found.value)


# --- files of MATLAB


def grids(n):
    """Displacements on Ncorr's reduced grid, in pixels, with a border where nothing was correlated."""
    u, v = (np.pad(one.reshape(4, 5), 1) for one in field(n))
    return 20 * u, 20 * v, np.pad(np.full((4, 5), 0.05), 1)


def ncorr(formatted=False, **changes):
    """Two frames with a pixel of 0.05 mm and a spacing of 19, so that places are 20 pixels apart."""
    names = ["plot_u_dic", "plot_v_dic", "plot_corrcoef_dic", "plot_u_ref_formatted", "plot_v_ref_formatted"]
    frames = np.zeros((1, FRAMES - 1), dtype=[(name, object) for name in names])
    for n in range(1, FRAMES):
        u, v, quality = grids(n)
        more = (0.05 * u, 0.05 * v) if formatted else (np.zeros((0, 0)), np.zeros((0, 0)))
        frames[0, n - 1] = (u, v, quality, *more)
    info = {
        "type": "regular",
        "spacing": 19.0,
        "pixtounits": 0.05,
        "units": "mm",
        "cutoff_corrcoef": np.ones(FRAMES - 1),
    }
    return {"data_dic_save": {"displacements": frames, "dispinfo": info | changes}}


def cell(arrays):
    found = np.empty((1, len(arrays)), dtype=object)
    found[0] = arrays
    return found


def duodic():
    """Camera's axes: y downwards, z away from it."""
    points = [np.stack([X + field(n)[0], -(Y + field(n)[1]), 0 * X + 500], axis=1) for n in range(FRAMES)]
    return {"DIC3DPPresults": {"Points3D": cell(points), "corrComb": cell([0 * X] * FRAMES)}}


@pytest.mark.parametrize(("made", "scale"), [(ncorr(), 0.05), (ncorr(formatted=True), None), (duodic(), None)])
def test_files_of_matlab(tmp_path, made, scale):
    savemat(tmp_path / "found.mat", made)
    record = read_points([tmp_path / "found.mat"])
    record = in_mm(record, None, scale, "here")
    assert len(record.names) == FRAMES  # Ncorr has none of the picture before compression
    places, moved, _ = common(plane(record, None), [1, 2])
    places = turned(places, "y", True)
    u, v = np.stack(field(1), axis=1)[np.lexsort((X, -Y))], np.stack(field(2), axis=1)[np.lexsort((X, -Y))]
    order = np.lexsort((places[:, 0], -places[:, 1]))
    if record.program == "Ncorr":  # its rows go downwards
        assert np.ptp(places, axis=0) == pytest.approx([4, 3])
        assert turned(moved[0], "y", True)[:, 0].max() == pytest.approx(field(1)[0].max())
    else:
        assert places[order] == pytest.approx(np.stack([X, Y], axis=1)[np.lexsort((X, -Y))])
        assert turned(moved[0], "y", True)[order] == pytest.approx(u)
        assert turned(moved[1], "y", True)[order] == pytest.approx(v)


def broken(how):
    """Variables of a file of MATLAB with one damage."""
    made = ncorr()
    info, frames = made["data_dic_save"]["dispinfo"], made["data_dic_save"]["displacements"]
    if how == "no spacing":
        del info["spacing"]
    elif how == "backward":
        info["type"] = "backward"
    elif how == "two spacings":
        info["spacing"] = np.ones(2)
    elif how == "nan":
        info["spacing"] = np.nan
    elif how == "another shape":
        frames[0, 1]["plot_v_dic"] = np.zeros((3, 3))
    elif how == "empty frame":
        frames[0, 1]["plot_u_dic"] = np.zeros((0, 0))
    elif how == "all lost":
        frames[0, 1]["plot_corrcoef_dic"] = np.zeros((6, 7))
    elif how == "other variables":
        return {"reference_save": 1.0}
    elif how == "one frame":
        return {"DIC3D": {"Points3D": cell([np.zeros((20, 3))])}}
    elif how == "other points":
        return {"DIC3D": {"Points3D": cell([np.zeros((20, 3)), np.zeros((19, 3))])}}
    elif how == "no fields":
        return {"data_dic_save": {"displacements": 1.0, "dispinfo": info}}
    return made


BROKEN = {
    "no spacing": "dispinfo.spacing: found nothing; expected one number",
    "two spacings": "dispinfo.spacing: found .*; expected one number",
    "nan": "dispinfo.spacing: found .*; expected one number",
    "backward": "dispinfo.type: found backward; expected one with displacements in the reference picture",
    "another shape": r"displacements\(2\): found .*; expected three arrays of one shape",
    "empty frame": r"displacements\(2\): found 1 x 0, 6 x 7",
    "all lost": "points: found 0 with a displacement",
    "other variables": "variables: found none; expected results of Ncorr",
    "one frame": "Points3D: found 1 frames",
    "other points": "Points3D: found arrays of different shapes",
    "no fields": "a damaged file",
    "cut": "a damaged file",
    "text": "a damaged file",
    "empty": "a damaged file",
}


@pytest.mark.parametrize("how", BROKEN)
def test_a_damaged_file_of_matlab_is_one_line(tmp_path, how):
    path = tmp_path / "found.mat"
    savemat(path, broken(how))
    content = path.read_bytes()
    path.write_bytes({"cut": content[: len(content) // 2], "text": b"x,y,u,v\n", "empty": b""}.get(how, content))
    with pytest.raises(InputError, match=BROKEN[how]) as found:
        read_points([path])
    assert "\n" not in str(found.value)
    assert "found.mat" in str(found.value)


def test_the_newer_files_of_matlab(tmp_path):
    """Version 7.3, as Ncorr and DuoDIC write it: HDF5 with references for the frames."""
    h5py = pytest.importorskip("h5py", reason="it is in requirements.lock")
    path = tmp_path / "found.mat"
    with h5py.File(path, "w") as file:
        group = file.create_group("data_dic_save")
        parts, info = group.create_group("displacements"), group.create_group("dispinfo")
        for place, name in enumerate(("plot_u_dic", "plot_v_dic", "plot_corrcoef_dic")):
            named = parts.create_dataset(name, (FRAMES - 1, 1), dtype=h5py.ref_dtype)
            for n in range(1, FRAMES):
                named[n - 1, 0] = file.create_dataset(f"#refs#/{name}{n}", data=grids(n)[place].T).ref
        kind = info.create_dataset("type", data=np.array([[ord(letter)] for letter in "regular"], dtype=np.uint16))
        kind.attrs["MATLAB_class"] = np.bytes_("char")
        info.create_dataset("spacing", data=[[19.0]])
    savemat(tmp_path / "older.mat", ncorr())
    for new, old in zip(read_matlab(path)[2], read_matlab(tmp_path / "older.mat")[2], strict=True):
        assert new[0] == pytest.approx(old[0])
        assert new[1] == pytest.approx(old[1])
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match="a damaged file"):
        read_matlab(path)


# --- what is done to points


@pytest.mark.parametrize(
    ("program", "column", "value"),
    [
        ("VIC-3D", 7, "-1"),
        ("VIC-2D", 4, "-1"),
        ("DICe", 5, "-1"),
        ("DICe", 7, "-1"),
        ("pyvale", 5, "0"),
        ("MatchID", 4, ""),
    ],
)
def test_points_that_were_not_correlated_are_left_out(tmp_path, program, column, value):
    path = write(tmp_path, program)[2]
    lines = path.read_text(encoding="utf-8").splitlines()
    cells = lines[-1].split(",")
    lines[-1] = ",".join([*cells[:column], value, *cells[column + 1 :]])
    path.write_text("\n".join(lines), encoding="utf-8")
    record = in_mm(read_points(sorted(tmp_path.iterdir())), None, PROGRAMS[program][1], "here")
    places, _, told = common(record, [1, 2])
    assert len(places) == 19
    assert told == ("1 of 20 points have no displacement in some frame, the least in frame_2.csv: left out",)


def test_points_that_are_not_in_each_file_are_left_out(tmp_path):
    path = write(tmp_path, "VIC-3D")[2]
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text(
        "\n".join([lines[0], *lines[:1:-1]]), encoding="utf-8"
    )  # without the first row, the others reversed
    places, moved, _ = common(plane(in_mm(read_points(sorted(tmp_path.iterdir())), None, None, "here"), None), [1, 2])
    assert len(places) == 19
    assert moved[1] == pytest.approx(np.stack(field(2), axis=1)[1:])


def test_what_moves_otherwise_than_all_around_it_is_an_outlier():
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 9, 30), np.linspace(0, 9, 30)))
    rng = seeded(1)
    places = np.stack([x, y], axis=1)
    moved = np.stack([0.1 * x**2, -0.3 * y], axis=1) + rng.normal(0, 0.01, places.shape)
    few = [17, 400, 733]
    moved[few] += 0.4
    found = np.flatnonzero(outliers(places, moved))
    assert set(few) <= set(found)
    assert len(found) <= len(few) + 4  # of 900 with noise, half a percent


def test_a_unit_of_points_that_is_not_known_is_refused(tmp_path):
    """Inches: an error, unless data.yaml says what they are."""
    for n, path in enumerate(write(tmp_path, "VIC-3D")):
        path.write_text(vic3d(n).replace('"X","Y"', '"X [in]","Y [in]"'), encoding="utf-8")
    record = read_points(sorted(tmp_path.iterdir()))
    with pytest.raises(
        InputError, match=r"frame_2.csv: unit: found in; expected one of pixel, um, mm, cm, m; another"
    ) as found:
        in_mm(record, None, None, "here")
    assert "\n" not in str(found.value)
    assert in_mm(record, "pixel", 25.4, "here").places[0] == pytest.approx(25.4 * record.places[0])
    for n, path in enumerate(sorted(tmp_path.iterdir())):
        path.write_text(vic3d(n).replace('"X","Y"', '"X [Mm]","Y [Mm]"'), encoding="utf-8")
    with pytest.raises(InputError, match=r"frame_2.csv: unit: found Mm; expected one of pixel"):
        in_mm(read_points(sorted(tmp_path.iterdir())), None, None, "here")
    savemat(tmp_path / "found.mat", ncorr(formatted=True, units="inches"))
    with pytest.raises(InputError, match=r"found.mat, frame 1: unit: found inches; expected one of pixel"):
        in_mm(read_points([tmp_path / "found.mat"]), None, None, "here")


def test_scale_and_axes(tmp_path):
    paths = write(tmp_path, "DICe")
    record = read_points(paths)
    with pytest.raises(
        InputError, match=r"here: scale: found none, and coordinates in pixels \(DICe\); expected .*--scale"
    ):
        in_mm(record, None, None, "here")
    with pytest.raises(InputError, match=r"scale: found 0.05, and coordinates in mm; expected no scale"):
        in_mm(record, "mm", 0.05, "here")
    with pytest.raises(InputError, match=r"found no names above 2 columns; expected columns x, y, u, v"):
        (tmp_path / "bare.txt").write_text("1 2\n3 4\n", encoding="utf-8")
        read_points([tmp_path / "bare.txt"])
    one = np.array([[1.0, 2.0, 3.0]])
    for up, down in [(up, down) for up in ("x", "-x", "y", "-y", "z", "-z") for down in (True, False)]:
        axes = np.stack([turned(row[None], up, down)[0] for row in np.eye(3)], axis=1)
        assert np.linalg.det(axes) == pytest.approx(1.0), "nothing is mirrored"
    assert turned(one, "x", False).tolist() == [[2, 3, 1]]


def test_positions_of_the_same_points(tmp_path):
    for n in range(FRAMES):
        u, v = field(n)
        np.savetxt(tmp_path / f"at_{n}.out", np.stack([X + u, Y + v], axis=1))
    record = read_points(sorted(tmp_path.iterdir()), ["x", "y"])
    same(record, None)
    (tmp_path / "at_1.out").write_text("1 2\n" * 19, encoding="utf-8")
    with pytest.raises(InputError, match=r"at_1.out: rows: found 19; expected 20, as in at_0.out"):
        read_points(sorted(tmp_path.iterdir()), ["x", "y"])


# --- form of tables


@pytest.mark.parametrize(
    ("content", "first", "second"),
    [
        ("01.02.2024;0,5;0,1\n01.02.2024;0,7;0,2\n", [0.5, 0.7], [0.1, 0.2]),
        ('a,0,0\nb,"0,5","1,2"\n', [0, 0.5], [0, 1.2]),
        ("a;0;0\nb;0.5;1.2\n", [0, 0.5], [0, 1.2]),
        ("a;0;0\nb;0,5;1,2\n", [0, 0.5], [0, 1.2]),
        ("a 0,5 1,2\nb 0,7 1\n", [0.5, 0.7], [1.2, 1]),
        ('"a","0.5","1.2"\n"b","0.7","1"\n', [0.5, 0.7], [1.2, 1]),
        ("v1.0;0,5;Nan\nv1.0;0,7;1,2\n", [0.5, 0.7], [np.nan, 1.2]),
    ],
)
def test_the_decimal_mark_is_that_of_the_numbers(tmp_path, content, first, second):
    (tmp_path / "t.csv").write_text(content, encoding="utf-8")
    found = read_table(tmp_path / "t.csv")
    assert found.column(1) == pytest.approx(first)
    assert found.column(2) == pytest.approx(second, nan_ok=True)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("1.000;0,5;0,1\n1.001;0,7;0,2\n", "line 1, column 1: found 1.000; expected a number"),  # or a thousand?
        ("0,5;0.1;0.2\n0,7;0.2;0.3\n", "line 1, column 1: found 0,5; expected a number"),
        ("1,2\n2,3\n" + '"' + "x" * 140_000 + '",3\n', "table: found field larger than field limit"),
        ('1,2\n2,3\n3,"4\n', "table: found .* EOF inside string .*; expected a readable table"),
    ],
)
def test_a_table_that_cannot_be_read_is_one_line(tmp_path, content, says):
    (tmp_path / "t.csv").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=says) as found:
        read_table(tmp_path / "t.csv").column(0)
    assert "\n" not in str(found.value)


def test_the_head_of_a_text_that_is_no_table_is_one_line(tmp_path):
    (tmp_path / "t.csv").write_text("x" * 140_000 + "\nforce [N],travel [mm]\n1,2\n2,3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"table: found field larger than field limit .*; expected a readable table"):
        read_head(tmp_path / "t.csv")


# --- records of machines

ZWICK = "Prüfzeit;Weg;Standardkraft\ns;µm;kN\n" + "".join(
    f"{n / 10};{-20.0 * n};{-0.0005 * n}\n".replace(".", ",") for n in range(20)
)


@pytest.mark.parametrize(
    ("content", "encoding"),
    [
        (INSTRON, "utf-8"),
        (INSTRON, "utf-16"),
        (ZWICK, "cp1252"),
        (INSTRON.replace(",", "\t"), "utf-8"),
        (INSTRON.replace("(s)", "(sec)"), "utf-8"),
    ],
)
def test_records_of_machines_in_one_unit(tmp_path, content, encoding):
    (tmp_path / "m.csv").write_text(content, encoding=encoding)
    found = read_machine(tmp_path / "m.csv")
    assert found.columns["time"] == pytest.approx(np.arange(20) / 10)
    assert found.columns["displacement"] == pytest.approx(0.02 * np.arange(20))
    assert found.columns["force"] == pytest.approx(0.5 * np.arange(20))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: "", "fewer than 2 rows of numbers"),
        (lambda t: t[: t.index('"0.000"')], "fewer than 2 rows of numbers"),
        (lambda t: t.replace('"Load"', '"Lot"'), "columns: found Time .*; expected a head with a column force or load"),
        (lambda t: t[t.index('"0.000"') :], "columns: found 3 columns without names; expected names"),
        (
            lambda t: t.replace('"0.500","0.1000","2.500"', '"0.500","0.1000","over"'),
            r"line 10, Load \[N\]: found over",
        ),
        (lambda t: t.rstrip()[:-8], r"line 24: found \d cells; expected 3"),
        (lambda t: t.replace('"0.500"', '"0.100"'), "an earlier time; expected times that rise"),
        (lambda t: t + "1,2,3,4\n", "line 25: found 4 cells; expected 3"),
        (lambda t: re.sub(r'"[\d.]+"\n', '""\n', t), "rows: found 0 with numbers in all columns"),
        (lambda t: t + "\0", "a binary file"),
        (
            lambda t: t.replace("(N)", "(lbf)"),
            r"m.csv: Load \[lbf\]: found the unit lbf; expected one of mN, N, kN, gf, kgf",
        ),
        (lambda t: t.replace("(N)", "(MN)"), r"Load \[MN\]: found the unit MN; expected one of mN, N, kN, gf, kgf"),
        (lambda t: t.replace("(mm)", "[%]"), r"Extension \[%\]: found the unit %; expected one of um, mm, cm, m"),
        (lambda t: t.replace("(N)", "(N/mm)"), r"Load \[N/mm\]: found the unit N/mm; expected one of mN, N"),
    ],
)
def test_a_damaged_record_is_one_line(tmp_path, change, says):
    (tmp_path / "m.csv").write_text(change(INSTRON), encoding="utf-8")
    with pytest.raises(InputError, match=says) as found:
        read_machine(tmp_path / "m.csv")
    assert "\n" not in str(found.value)
    assert "m.csv" in str(found.value)


def test_ramps_end_where_the_load_turns():
    once = np.concatenate([np.linspace(0, 10, 50), np.linspace(10, 1, 40)])
    noisy = np.tile(once, 3) + seeded(2).normal(0, 0.05, 270)
    found = ramps(noisy)
    assert len(found) == 3
    assert [stop for _, stop in found] == pytest.approx([49, 139, 229], abs=2)
    assert [start for start, _ in found] == pytest.approx([0, 90, 180], abs=3)
