"""Input without end - pipes, devices, bombs of every kind: one line in a bounded time and memory.

Each case runs in a process of its own, which is ended after `SECONDS` and cannot take more than `MEMORY`: code without the
limit fails here, and does not take the other tests with it.
"""

from __future__ import annotations

import os
import resource
import socket
import struct
import subprocess
import sys
import zlib
from itertools import pairwise

import numpy as np
import pytest
import yaml
from seeds import generator

from fingerfit.imaging.pictures import Picture, write_picture

SECONDS = 120
"""A check of this study takes 2 s; forty times that, for machines that do something else beside."""
MEMORY = 8 * 2**30
"""Of addresses, of which numpy and SimpleITK take 2 GB before they do anything."""


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A study with pictures, points and a mesh of its own, a template and an effect, and its config."""
    monkeypatch.chdir(tmp_path)
    study = tmp_path / "study"
    (study / "effects").mkdir(parents=True)
    rng = generator(1)
    for name in ("before", "step_1"):
        frame = Picture(rng.uniform(0, 4000, (20, 20)), np.full(2, 1.0), np.full(2, -4.0), np.eye(2))
        write_picture(study / f"{name}.mha", frame)
    (study / "steps.csv").write_text(
        "step,displacement,force,picture,points\n1,0.5,7,step_1.mha,points.csv\n2,1.0,14,,\n"
    )
    (study / "points.csv").write_text("x,y,ux,uy\n1,1,0,-0.1\n")
    (study / "mesh.inp").write_text("*INCLUDE, INPUT=nodes.inp\n" + MESH)
    (study / "nodes.inp").write_text(NODES)
    (study / "own.inp.j2").write_text("{% include 'block.inp.j2' %}\n{% include 'part.j2' %}\n")
    (study / "part.j2").write_text("** a part\n")
    (study / "effects/mine.yaml").write_text(yaml.safe_dump(EFFECT))
    data = {
        "title": "t",
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": "force",
        "steps": "steps.csv",
        "pictures": {"before": "before.mha", "noise": 10},
        "noise": {"force": 0.1, "points": 0.01},
        "body": {"mesh": "mesh.inp", "thickness": 70, "layers": [{"name": "block"}]},
        "boundary": {"base": "held", "indenter": "glued"},
    }
    (study / "study.yaml").write_text(yaml.safe_dump(data))
    config = {
        "study": "study",
        "model": {
            "template": "own.inp.j2",
            "material": {"alpha": 1.4, "poisson": 0.45},
            "parameters": {"mu": {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1.0}},
        },
        "fit": {"score": "nmi", "stages": [{"name": "s", "kind": "independent"}]},
    }
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(config))
    return tmp_path


NODES = "*NODE\n" + "".join(f"{1 + 3 * j + i}, {6.0 * i}, {6.0 * j}\n" for j in range(3) for i in range(3))
MESH = """*ELEMENT, TYPE=CPE4, ELSET=BLOCK
1, 1, 2, 5, 4
2, 2, 3, 6, 5
3, 4, 5, 8, 7
4, 5, 6, 9, 8
*NSET, NSET=BOTTOM
1, 2, 3
*NSET, NSET=TOP
7, 8, 9
"""
EFFECT = {
    "title": "t",
    "words": "w",
    "look": "l",
    "confirm": "c",
    "acts": "material",
    "parameters": {"slope": {"unit": "1", "absent": 0, "lower": -1, "upper": 1, "step": 0.1}},
    "changes": {"field": "slope * (x / width - 0.5)"},
}


def run(*arguments):
    """The command line in a process of its own: its exit code and its lines of errors."""

    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))

    command = [sys.executable, "-m", "fingerfit", *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, preexec_fn=limit, timeout=SECONDS, stdin=subprocess.DEVNULL
    )
    return done.returncode, [line for line in done.stderr.splitlines() if line]


def told(*arguments):
    """The one line of errors."""
    code, lines = run(*arguments)
    assert code == 1
    assert len(lines) == 1, lines
    assert lines[0].startswith("fingerfit: error: ")
    return lines[0].removeprefix("fingerfit: error: ")


def write(name, content):
    return lambda place: (place / name).write_bytes(content.encode() if isinstance(content, str) else content)


def formula(text):
    return write("study/effects/mine.yaml", yaml.safe_dump({**EFFECT, "changes": {"field": text}}))


def pipe(name):
    def change(place):
        (place / name).unlink(missing_ok=True)
        os.mkfifo(place / name)

    return change


def link(name, to):
    def change(place):
        (place / name).unlink(missing_ok=True)
        (place / name).symlink_to(to)

    return change


def folder(name):
    return lambda place: [(place / name).unlink(), (place / name).mkdir()]


def unix_socket(name):
    def change(place):
        (place / name).unlink()
        with socket.socket(socket.AF_UNIX) as one:
            one.bind(name)  # relative: such names are short

    return change


def claim(name, old, new):
    def change(place):
        content = (place / name).read_bytes()
        assert old in content
        (place / name).write_bytes(content.replace(old, new, 1))

    return change


def bombs(letters, first, of):
    """Lines of YAML that repeat the line before ten times each."""
    lines = [f"{letters[0]}: &{letters[0]} {first}"]
    lines += [f"{new}: &{new} {of([f'*{old}'] * 10)}" for old, new in pairwise(letters)]
    return "\n".join(lines) + "\n"


def large_png(place):
    """A header of 100 000 x 100 000 pixels in a file of 100 bytes."""
    head = struct.pack(">IIBBBBB", 100_000, 100_000, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(bytes(100))), (b"IEND", b"")]
    content = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    (place / "study/before.png").write_bytes(content)
    claim("study/study.yaml", b"before.mha", b"before.png")(place)


def mesh_of_meshio(place):
    pipe("study/mesh.vtk")(place)
    claim("study/study.yaml", b"mesh.inp", b"mesh.vtk")(place)


def pixels_elsewhere(to):
    def change(place):
        header = (place / "study/step_1.mha").read_bytes().split(b"ElementDataFile")[0]
        header = header.replace(b"CompressedData = True", b"CompressedData = False")
        lines = [line for line in header.splitlines() if not line.startswith(b"CompressedDataSize")]
        (place / "study/step_1.mhd").write_bytes(b"\n".join([*lines, b"ElementDataFile = " + to.encode() + b"\n"]))
        claim("study/steps.csv", b"step_1.mha", b"step_1.mhd")(place)
        os.mkfifo(place / "study/pixels")

    return change


def series_with_a_pipe(place):
    (place / "study/step_1.mha").unlink()
    (place / "study/step_1.mha").mkdir()
    os.mkfifo(place / "study/step_1.mha/1.dcm")


SCALE = "{% for a in range(99999) %}{% for b in range(99999) %}{% set c = a * b %}{% endfor %}{% endfor %}\n"
CASES = {
    # YAML
    "aliases of aliases": (write("study/study.yaml", bombs("abcdefghij", "[x, x, x]", lambda all: f"[{', '.join(all)}]")),
                           "study.yaml: line 7: found aliases that repeat 4.11e+06 values; expected at most 524288"),
    "merged aliases": (write("study/study.yaml", bombs("abcdefghij", "{x: 1}", lambda all: f"{{<<: [{', '.join(all)}]}}")),
                       "found aliases that repeat"),
    "an alias of itself": (write("study/study.yaml", "title: &a [*a]\n"), "line 1: found an alias of what it is in"),
    "deep YAML": (write("config.yaml", "study: " + "[" * 300_000), "config.yaml: line 1: found lists and mappings too deep"),
    "a number without end": (write("study/study.yaml", "title: " + "1:" * 300_000 + "1\n"), "line 1: found a number of 600001"),
    "a large document": (write("config.yaml", "#" * 2**21), "config.yaml: file: found 2 MB; expected at most 1 MB"),
    "YAML without end": (link("study/study.yaml", "/dev/zero"), "study.yaml: file: found a device"),
    "config from a pipe": (pipe("config.yaml"), "config.yaml: file: found a pipe; expected a readable YAML file"),
    "config is a folder": (folder("config.yaml"), "config.yaml: file: found a folder"),
    "an effect from a pipe": (pipe("study/effects/mine.yaml"), "mine.yaml: file: found a pipe"),
    "a link to itself": (link("study/study.yaml", "study.yaml"), "study.yaml: file: found Too many levels of symbolic links"),
    # tables
    "steps without end": (link("study/steps.csv", "/dev/zero"), "steps.csv: steps: found a device"),
    "steps from a pipe": (pipe("study/steps.csv"), "steps.csv: steps: found a pipe"),
    "a large table of steps": (write("study/steps.csv", "step,force\n" * 10**5), "steps.csv: steps: found 1.05 MB"),
    "points from a socket": (unix_socket("study/points.csv"), "points.csv: points: found a socket"),
    "points in Latin-1": (write("study/points.csv", b"x,y,ux,uy\n1,1,0,\xb5\n"),
                          "points.csv: points: found byte 0xb5 in line 2, which is not UTF-8"),
    # meshes
    "mesh from a pipe": (pipe("study/mesh.inp"), "mesh.inp: deck: found a pipe"),
    "mesh of meshio from a pipe": (mesh_of_meshio, "mesh.vtk: mesh: found a pipe"),
    "included without end": (link("study/nodes.inp", "/dev/zero"), "nodes.inp: deck: found a device"),
    "included from a pipe": (pipe("study/nodes.inp"), "nodes.inp: deck: found a pipe"),
    "included from a link to itself": (link("study/nodes.inp", "nodes.inp"), "nodes.inp: deck: found Too many levels"),
    "includes itself": (write("study/nodes.inp", "*INCLUDE, INPUT=nodes.inp\n" * 20),
                        "nodes.inp: line 1, *INCLUDE: found nodes.inp, which is being read"),
    # pictures
    "picture from a pipe": (pipe("study/before.mha"), "before.mha: picture: found a pipe"),
    "picture without end": (link("study/step_1.mha", "/dev/zero"), "step_1.mha: picture: found a device"),
    "a large header": (claim("study/before.mha", b"DimSize = 20 20", b"DimSize = 100000 100000"),
                       "before.mha: picture: found 100000 x 100000 pixels, 112 GB to read"),
    "a large PNG": (large_png, "before.png: picture: found 100000 x 100000 pixels"),
    "many channels": (claim("study/before.mha", b"DimSize = 20 20", b"ElementNumberOfChannels = 1000000000\nDimSize = 20 20"),
                      "before.mha: picture: found 20 x 20 pixels"),
    "pixels from a pipe": (pixels_elsewhere("pixels"), "pixels: picture: found a pipe; expected a file, as the header step_1.mhd"),
    "pixels without end": (pixels_elsewhere("/dev/zero"), "/dev/zero: picture: found a device"),
    "a series with a pipe": (series_with_a_pipe, "1.dcm: picture: found a pipe"),
    # formulas
    "powers of powers": (formula("9**9**9**9"), "changes.field: found '9**9**9**9': a number beyond double precision"),
    "a long text": (formula("'a' * 10 ** 11"), "changes.field: found "),
    "a deep formula": (formula("-" * 1500 + "x"), "operations more than 100 deep"),
    "a long formula": (formula("x" + " + x" * 10**5), "400001 characters; at most 2000"),
    # templates
    "template from a pipe": (pipe("study/own.inp.j2"), "own.inp.j2: template: found a pipe"),
    "part from a device": (link("study/part.j2", "/dev/zero"), "part.j2: template: found a device"),
    "a large template": (write("study/part.j2", " " * 2**21), "part.j2: template: found 2 MB; expected at most 1 MB"),
    "template in Latin-1": (write("study/part.j2", b"** \xb5\n"), "part.j2: template: found byte 0xb5 in line 1, which is not"),
    "a part of itself": (write("study/part.j2", "{% include 'part.j2' %}"), "part.j2: line 1: found parts, macros or"),
    "a long deck": (write("study/part.j2", "{% for a in range(99999) %}{{ 'x' * 10000 }}{% endfor %}"),
                    "own.inp.j2: template: found a deck of more than 64 MB"),
    "a large text": (write("study/part.j2", "{{ 'x' * 10 ** 10 }}"), "own.inp.j2: template: found no end; expected a deck that"),
    "a wide text": (write("study/part.j2", "{{ 'x'|center(10 ** 11) }}"), "own.inp.j2: template: found no end"),
    "a deep expression": (write("study/part.j2", "{{ " + "(" * 10**5 + "1" + ")" * 10**5 + " }}"),
                          "found parts, macros or expressions within each other without end"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_one_line(place, name):
    change, expected = CASES[name]
    change(place)
    assert expected in told("check", "study", "--config", "config.yaml")


def test_the_study_itself_is_fine(place):
    assert run("check", "study", "--config", "config.yaml") == (0, [])


def test_loops_within_loops(place):
    """At one second, as `SECONDS` of `fingerfit.deck.render` would be waited for by every run of the tests."""
    (place / "study/part.j2").write_text(SCALE)
    program = "import fingerfit.deck.render as r, fingerfit.cli as c; r.SECONDS = 1; c.main(['check', 'study'])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=SECONDS)
    assert done.stderr.splitlines() == [
        "fingerfit: error: own.inp.j2: template: found no end after 1 s; expected a deck that is made in less"
    ]


def test_files_that_include_each_other_many_times(place):
    """No file includes itself, but each the next one a hundred times: 10^12 lines by six files."""
    for number in range(1, 6):
        (place / f"study/{number}.inp").write_text(f"*INCLUDE, INPUT={number + 1}.inp\n" * 100)
    (place / "study/6.inp").write_text("** nothing\n")
    (place / "study/nodes.inp").write_text("*INCLUDE, INPUT=1.inp\n" + NODES)
    assert "mesh.inp: deck: found more than 256 MB with what it includes" in told("check", "study")


def test_files_within_files_within_files(place):
    """A chain of ten: none includes itself, and each is short."""
    for number in range(1, 10):
        (place / f"study/{number}.inp").write_text(f"*INCLUDE, INPUT={number + 1}.inp\n")
    (place / "study/10.inp").write_text(NODES)
    (place / "study/nodes.inp").write_text("*INCLUDE, INPUT=1.inp\n")
    assert "7.inp: line 1, *INCLUDE: found 8.inp; expected files that include each other at most 8" in told(
        "check", "study"
    )
