"""anatomy.yaml: numbers of a finger, and bones that do not fit."""

from battery import INF, NAN, values

AREA = "anatomy.yaml"
FILE = "anatomy.yaml"
COMMAND = ("finger", "--anatomy", "anatomy.yaml", "--size", "20", "--element", "C3D4", "--out", "finger.inp")


def of(key, *found, **more):
    return values(FILE, key, *found, command=COMMAND, **more)


CASES = [
    *of("length", 0, -34, "34 mm", NAN, INF, [34], None, True, {"mm": 34}),
    *of("length", 1e308, 1e-308, 10, says=["anatomy"]),
    *of("width", 0, "x", NAN, 3, says=["anatomy", "width"]),
    *of("palmar", -1, 1, says=["anatomy"]),
    *of("dorsal", 0, 1.0, says=["anatomy"]),
    *of("tip", 0, 30, says=["anatomy"]),
    *of("taper", 0.6, -0.6, NAN),
    *of("slope", 0.6, "x"),
    *of("pulp", 0.7),
    *of("knuckle", -0.7),
    *of("joint", 0, 2, 40, says=["anatomy", "joint"]),
    *of("gap", 0, -1, 30, says=["anatomy"]),
    *of("bone_cover", 0.5, -1, says=["anatomy", "bone_cover"]),
    *of("bone_cover", 30, says=["anatomy"]),
    *of("bone_width", 14, 0, says=["anatomy", "bone_width"]),
    *of("bone_height", 14, says=["anatomy", "bone_height"]),
    *of("bone_depth", 9, says=["anatomy"]),
    *of("nail_length", 0, 99, says=["anatomy|nail"]),
    *of("nail_angle", 0, 270, NAN, says=["anatomy|nail"]),
    *of("epidermis", 0, -0.5, 9, "thin", says=["anatomy"]),
    *of("dermis", -0.1, 9, says=["anatomy"]),
    *of("lenght", 34),
    *of("unit", "mm"),
]  # fmt: skip
