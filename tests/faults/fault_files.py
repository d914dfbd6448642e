"""Results that are damaged on the disk: a flipped bit, half a file, an empty one, none."""

import os

from workspace import MODEL, Fault

AREA = "damaged results"
FILES = (
    "settings.json", "prepared.npz", "mesh.inp", "rounds/0.json", "rounds/1.json", "rounds/2.json", "estimate.json",
    "table.txt", "figures/force.png", "compare.npz", "diagnosis.json", "diagnosis.npz", "rung.json", "simulations.json",
    "residual.npz", "../ladder.json", "../report.html", "SIM/solution.npz", "SIM/deck.inp", "SIM/solver.json", "MESH",
)  # fmt: skip


def flip(path):
    data = bytearray(path.read_bytes())
    at = len(data) // 2
    while path.suffix != ".npz" and not chr(data[at]).isdigit() and at < len(data) - 1 and path.suffix != ".png":
        at += 1  # of text a digit, which is read as another one
    data[at] ^= 1
    path.write_bytes(bytes(data))


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


ASKED = ("estimate.json", "table.txt", "figures/force.png", "diagnosis.json", "../ladder.json", "../report.html")
"""What the targets ask for; the rest may stay deleted until something is made of it again."""
DAMAGES = {
    "flipped": flip,
    "cut": cut,
    "emptied": lambda path: path.write_bytes(b""),
    "deleted": lambda path: path.unlink(),
}


def where(name):
    def find(place):
        if name == "MESH":
            return next((place / "results/study/meshes").iterdir())
        return place.sim() / name[4:] if name.startswith("SIM/") else place / f"{MODEL}/{name}"

    return find


def damaged(name, damage):
    found = []

    def happens(place):
        path = where(name)(place)
        kept = path.stat()
        DAMAGES[damage](path)
        if path.exists():  # a disk that fails does not change the time
            os.utime(path, ns=(kept.st_atime_ns, kept.st_mtime_ns))
        found[:] = [path] if path.exists() or name in ASKED else []

    def mends(place):
        for path in found:
            path.unlink(missing_ok=True)

    return Fault(f"{name.removeprefix('../').replace('SIM', 'a simulation').replace('MESH', 'the mesh of simulations')}: {damage}",
                 happens, "diagnosed", ("diagnose",), (name.rpartition("/")[2].replace("MESH", r"[0-9a-f]{20}\.inp"), "remove|delete|rm |snakemake|fingerfit"),
                 mends, lambda place: list(found))  # fmt: skip


FAULTS = [damaged(name, damage) for name in FILES for damage in DAMAGES]
