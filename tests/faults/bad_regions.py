"""Regions of a study: outlines, pictures of labels, sets."""

import numpy as np
from battery import all_of, bad, fine, holds, put

from fingerfit.imaging.pictures import Picture, read_picture, write_picture

AREA = "regions"
FILE = "study/study.yaml"
SQUARE = [[3, 3], [9, 3], [9, 9], [3, 9]]


def region(name, *says, make=bad, place="plane", files=(), **keys):
    regions = [{"name": "scar", **keys}]
    return make(name, all_of(*files, put(FILE, "body.regions", regions)), *says, place=place)


def labels(change):
    """A picture of labels, 1 in its middle and 2 beside it, as the picture before compression but for what is changed."""

    def make(place):
        before = read_picture(place / "study/before.mha")
        values = np.zeros(before.values.shape)
        middle = tuple(size // 2 for size in values.shape)
        values[middle[0] - 3 : middle[0] + 3, middle[1] - 3 : middle[1]] = 1
        values[middle[0] - 3 : middle[0] + 3, middle[1] : middle[1] + 3] = 2
        picture = change(Picture(values, before.spacing, before.origin, before.direction))
        write_picture(place / "study/labels.mha", picture, np.float32)

    return make


def moved(**own):
    return lambda picture: Picture(
        **{**vars(picture), **{name: value(getattr(picture, name)) for name, value in own.items()}}
    )


def painted(name, change, *says, label=1, **more):
    return region(name, *says, files=[labels(change)], labels="labels.mha", label=label, **more)


CASES = [
    region("an outline", make=fine, outline=SQUARE),
    region("an outline that is closed", make=fine, outline=[*SQUARE, SQUARE[0]]),
    region("an outline in a table", make=fine, outline="o.csv", files=[holds("study/o.csv", "x,y\n3,3\n9,3\n9,9\n")]),
    region("an outline that crosses itself", "regions.0.outline", "side 1 across side 3", outline=[[3, 3], [9, 9], [9, 3], [3, 9]]),
    region("an outline along a line", "regions.0.outline", outline=[[3, 3], [6, 6], [9, 9]]),
    region("an outline of two corners", "regions.0.outline", outline=[[3, 3], [9, 9]]),
    region("an outline with a corner twice", "regions.0.outline", "twice", outline=[[3, 3], [3, 3], [9, 9], [3, 9]]),
    region("an outline with NaN", "regions.0.outline", outline=[[3, 3], [float("nan"), 3], [9, 9]]),
    region("an outline in micrometres", "regions.0", outline=[[3e9, 3e9], [9e9, 3e9], [9e9, 9e9]]),
    region("an outline beside the body", "regions.0", "nothing of the body", outline=[[33, 3], [39, 3], [39, 9]]),
    region("an outline in one element", "regions.0", "less than half of every element", outline=[[3, 3], [5, 3], [5, 5]]),
    region("an outline in no file", "none.csv", outline="none.csv"),
    region("an outline in a table of other columns", "o.csv", "x,y", outline="o.csv", files=[holds("study/o.csv", "a,b\n1,2\n")]),
    region("an outline in a table with words", "o.csv", "row 3", outline="o.csv", files=[holds("study/o.csv", "x,y\n3,3\n9,up\n9,9\n")]),
    region("an outline of a body in space", "regions.0.outline", "in space", outline=SQUARE, place="volume"),
    region("nothing that says where", "regions.0", "one of outline, labels, elements"),
    region("an outline and labels", "regions.0", "outline and labels", outline=SQUARE, labels="labels.mha"),
    region("a label of an outline", "regions.0.label", outline=SQUARE, label=2),
    region("a set of a body without a mesh file", "regions.0.elements", elements="TOP"),
    region("a set that is not there", "regions.0.elements", "LOWER, TOP, UPPER", elements="SCAR", place="meshed"),
    region("a set", make=fine, elements="UPPER", place="meshed"),
    region("a key that is none", "regions.0", "outlin", outlin=SQUARE),
    bad("the name of a layer", put(FILE, "body.regions", [{"name": "Top", "outline": SQUARE}]), "regions.0.name"),
    bad("two on the same elements", put(FILE, "body.regions", [{"name": "a", "outline": SQUARE}, {"name": "b", "outline": SQUARE}]), "regions.1", "b and a on"),
    bad("a constant of no region", put("config.yaml", "model.material.mu_scar", 0.1), "mu_scar"),
    bad("a constant and the effect", all_of(
        put(FILE, "body.regions", [{"name": "scar", "outline": SQUARE}]), put("config.yaml", "model.material.mu_scar", 0.1),
        put("config.yaml", "model.effects", {"region_scar": {}}),
    ), "mu_scar", "region_scar"),
    fine("a fixed constant", all_of(put(FILE, "body.regions", [{"name": "scar", "outline": SQUARE}]), put("config.yaml", "model.material.mu_scar", 0.1))),
    painted("labels", lambda picture: picture, make=fine),
    painted("labels of a volume", lambda picture: picture, make=fine, place="volume"),
    painted("labels that are no whole numbers", moved(values=lambda v: v * 1.5), "labels.mha", "1.5", "whole numbers"),
    painted("labels below 0", moved(values=lambda v: -v), "labels.mha", "whole numbers"),
    painted("no such label", lambda picture: picture, "regions.0.label", "one of 1, 2", label=7),
    painted("no label at all", moved(values=lambda v: 0 * v), "regions.0.label", "above 0"),
    painted("labels of another spacing", moved(spacing=lambda s: 2 * s), "labels.mha", "spacing"),
    painted("labels elsewhere", moved(origin=lambda o: o + 1), "labels.mha", "origin"),
    painted("labels turned round", moved(direction=lambda d: -d), "labels.mha", "direction"),
    painted("labels of fewer pixels", moved(values=lambda v: v[1:]), "labels.mha", "pixels"),
    region("labels in no file", "none.mha", labels="none.mha"),
    region("labels in a file of text", "labels.mha", labels="labels.mha", files=[holds("study/labels.mha", "hello\n")]),
]  # fmt: skip
