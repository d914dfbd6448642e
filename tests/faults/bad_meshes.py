"""Meshes in files: nodes, elements, sets, and files that are none."""

from battery import NOT_FILES, all_of, bad, either, fine, holds, instead, put, recoded, swap

AREA = "meshes"
FILE = "study/mesh.inp"


def text(name, old, new, *says, **more):
    return more.pop("make", bad)(name, swap(FILE, old, new), *(says or ["mesh.inp"]), place="meshed", **more)


def mesh(name, content, *says, **more):
    return more.pop("make", bad)(name, holds(FILE, content), *(says or ["mesh.inp"]), place="meshed", **more)


def other(name, file, content, *says, **more):
    """A mesh in another format."""
    change = all_of(holds(f"study/{file}", content), put("study/study.yaml", "body.mesh", file))
    return bad(name, change, *(says or [file]), place="meshed", **more)


VTK = "# vtk DataFile Version 3.0\nm\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 double\n0 0 0 1 0 0 0 1 0\nCELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n5\n"
CASES = [
    *(bad(name, instead(FILE, make), "mesh.inp", place="meshed") for name, make in NOT_FILES.items()),
    mesh("empty", ""),
    mesh("a comment", "** nothing\n"),
    mesh("text", "hello\n"),
    mesh("bytes", bytes(range(256)) * 10),
    mesh("NUL bytes", b"\0" * 3000),
    mesh("nodes only", "*NODE\n1, 0., 0.\n2, 1., 0.\n"),
    mesh("elements only", "*ELEMENT, TYPE=CPE4\n1, 1, 2, 5, 4\n"),
    bad("cut in the nodes", recoded(FILE, lambda data: data[:70]), "mesh.inp", place="meshed"),
    bad("cut in the elements", recoded(FILE, lambda data: data[: data.index(b"ELSET=UPPER")]), "mesh.inp|elements", place="meshed"),
    bad("cut in a line", recoded(FILE, lambda data: data[: data.index(b", 8, 7\n4,")]), "mesh.inp", place="meshed"),
    bad("cut before the sets", recoded(FILE, lambda data: data[: data.index(b"*NSET, NSET=BOTTOM")]), "mesh.inp", place="meshed"),
    text("no set of the base", "NSET=BOTTOM", "NSET=GROUND", "BOTTOM"),
    text("no set of the indenter", "NSET=TOP", "NSET=UP", "TOP"),
    text("an empty set", "*NSET, NSET=TOP\n7, 8, 9\n", "*NSET, NSET=TOP\n", "TOP"),
    text("no set of a layer", "ELSET=UPPER", "ELSET=OVER", "UPPER"),
    text("an element in no layer", "*ELEMENT, TYPE=CPE4, ELSET=UPPER\n3, 4, 5, 8, 7\n", "*ELEMENT, TYPE=CPE4\n3, 4, 5, 8, 7\n*ELEMENT, TYPE=CPE4, ELSET=UPPER\n", "mesh.inp|layers|element"),
    text("an element in two layers", "*NSET, NSET=BOTTOM\n", "*ELSET, ELSET=LOWER\n3\n*NSET, NSET=BOTTOM\n", "LOWER|UPPER|mesh.inp"),
    text("base and indenter share a node", "7, 8, 9\n*NSET, NSET=INDENTER", "1, 8, 9\n*NSET, NSET=INDENTER", "TOP|BOTTOM|mesh.inp"),
    text("an indenter that is not on the top", "NSET=INDENTER\n8", "NSET=INDENTER\n5", "INDENTER|mesh.inp"),
    text("an indenter of two nodes", "NSET=INDENTER\n8", "NSET=INDENTER\n8, 9", "INDENTER|mesh.inp", make=either),
    text("a set of nodes that are not there", "*NSET, NSET=TOP\n7, 8, 9", "*NSET, NSET=TOP\n7, 8, 99", "mesh.inp", "99"),
    text("a set of sets that are not there", "*NSET, NSET=TOP\n7, 8, 9", "*NSET, NSET=TOP\nUP", "mesh.inp", "UP"),
    text("an unknown element", "TYPE=CPE4, ELSET=UPPER", "TYPE=CPE5, ELSET=UPPER", "mesh.inp", "CPE5"),
    text("no type", "*ELEMENT, TYPE=CPE4, ELSET=UPPER", "*ELEMENT, ELSET=UPPER", "mesh.inp", "TYPE"),
    text("solid elements with plane nodes", "TYPE=CPE4, ELSET=UPPER", "TYPE=C3D4, ELSET=UPPER"),
    text("a node too few in an element", "3, 4, 5, 8, 7", "3, 4, 5, 8"),
    text("a node too many in an element", "3, 4, 5, 8, 7", "3, 4, 5, 8, 7, 9"),
    text("a node that is not there", "3, 4, 5, 8, 7", "3, 4, 5, 8, 77", "mesh.inp", "77"),
    text("a node twice in an element, which makes a triangle", "3, 4, 5, 8, 7", "3, 4, 5, 5, 7", make=either),
    text("an element without area", "3, 4, 5, 8, 7", "3, 4, 5, 6, 5"),
    text("an element turned round", "3, 4, 5, 8, 7", "3, 7, 8, 5, 4", "mesh.inp", "element 3|3"),
    text("an element that crosses itself", "3, 4, 5, 8, 7", "3, 4, 8, 5, 7", "mesh.inp", "3"),
    text("an element with a corner pushed in", "5, 6., 6.", "5, 11.9, 11.9", "mesh.inp"),
    text("an element number twice", "4, 5, 6, 9, 8", "3, 5, 6, 9, 8", "mesh.inp", "3"),
    text("a node number twice", "9, 12., 12.", "8, 12., 12.", "mesh.inp", "8"),
    text("two nodes in one place", "9, 12., 12.", "9, 12., 12.\n10, 12., 12.", make=either),
    text("a node that no element uses", "9, 12., 12.", "9, 12., 12.\n10, 99., 99."),
    text("a body in two pieces", "4, 5, 6, 9, 8\n", "4, 5, 6, 9, 8\n5, 11, 12, 13, 14\n*NODE\n11, 20., 0.\n12, 21., 0.\n13, 21., 1.\n14, 20., 1.\n", "mesh.inp", "elements: found apart"),
    bad("a layer that shares no node with the other", all_of(
        swap(FILE, "9, 12., 12.\n", "9, 12., 12.\n14, 0., 6.\n15, 6., 6.\n16, 12., 6.\n"),
        swap(FILE, "3, 4, 5, 8, 7\n4, 5, 6, 9, 8", "3, 14, 15, 8, 7\n4, 15, 16, 9, 8"),
    ), "mesh.inp", "elements: found apart", place="meshed"),
    text("NaN as coordinate", "9, 12., 12.", "9, nan, 12.", "mesh.inp", "nan"),
    text("infinite coordinate", "9, 12., 12.", "9, 1e400, 12."),
    text("a huge coordinate", "9, 12., 12.", "9, 1e308, 12.", "mesh.inp|mesh"),
    text("text as coordinate", "9, 12., 12.", "9, 12., up", "mesh.inp", "up"),
    text("a coordinate missing", "9, 12., 12.", "9, 12.", make=either),  # 0, as ABAQUS takes it: an inverted element
    text("a node number of 0", "9, 12., 12.", "0, 12., 12."),
    text("a node number below 0", "9, 12., 12.", "-9, 12., 12."),
    text("a node number that is no whole number", "9, 12., 12.", "9.5, 12., 12.", "mesh.inp", "9.5"),
    text("a huge node number", "9, 12., 12.", f"{10**30}, 12., 12."),
    text("an unknown keyword", "*NSET, NSET=TOP", "*NSETT, NSET=TOP", "mesh.inp", "NSETT"),
    text("an unknown parameter", "*NSET, NSET=TOP", "*NSET, NSET=TOP, SORTED=NO", "mesh.inp", "SORTED"),
    text("data before a keyword", "*NODE, NSET=ALL\n", "1, 0., 0.\n", "mesh.inp", "line 1"),
    text("an include that is not there", "*NSET, NSET=TOP", "*INCLUDE, INPUT=none.inp\n*NSET, NSET=TOP", "none.inp"),
    text("an include of itself", "*NSET, NSET=TOP", "*INCLUDE, INPUT=mesh.inp\n*NSET, NSET=TOP"),
    text("an include without a file", "*NSET, NSET=TOP", "*INCLUDE\n*NSET, NSET=TOP", "mesh.inp", "INPUT"),
    text("an include of a folder", "*NSET, NSET=TOP", "*INCLUDE, INPUT=../study\n*NSET, NSET=TOP", "study"),
    text("an include of /dev/zero", "*NSET, NSET=TOP", "*INCLUDE, INPUT=/dev/zero\n*NSET, NSET=TOP", "zero"),
    text("generated nodes without end", "*NSET, NSET=TOP\n7, 8, 9", "*NSET, NSET=TOP, GENERATE\n7, 1000000000000, 1"),
    text("generated nodes without end, before they are", "*NODE, NSET=ALL", "*NSET, NSET=TOP, GENERATE\n1, 1000000000000, 1\n*NODE, NSET=ALL", "mesh.inp", "line 2", "1000000000000"),
    fine("generated nodes with huge gaps", all_of(
        swap(FILE, "9, 12., 12.", "1000000000000, 12., 12."),
        swap(FILE, "4, 5, 6, 9, 8", "4, 5, 6, 1000000000000, 8"),
        swap(FILE, "*NSET, NSET=TOP\n7, 8, 9", "*NSET, NSET=TOP, GENERATE\n7, 1000000000000, 1"),
    ), place="meshed"),
    text("generated nodes with step 0", "*NSET, NSET=TOP\n7, 8, 9", "*NSET, NSET=TOP, GENERATE\n7, 9, 0"),
    text("a cell of 1 MB", "9, 12., 12.", f"9, {'1' * (1 << 20)}, 12."),
    text("a line of 10^5 members", "*NSET, NSET=TOP\n7, 8, 9", "*NSET, NSET=TOP\n" + "7, " * 10**5 + "8", make=either),
    fine("CRLF", recoded(FILE, lambda data: data.replace(b"\n", b"\r\n")), place="meshed"),
    fine("a byte order mark", recoded(FILE, lambda data: b"\xef\xbb\xbf" + data), place="meshed"),
    fine("small letters", recoded(FILE, lambda data: data.lower()), place="meshed"),
    other("a format that nobody knows", "mesh.xyz", "hello\n"),
    other("no ending", "mesh", "hello\n", "study/mesh|: mesh"),
    other("VTK: empty", "mesh.vtk", ""),
    other("VTK: text", "mesh.vtk", "hello\n"),
    other("VTK: cut", "mesh.vtk", VTK[:90]),
    other("VTK: triangles without sets", "mesh.vtk", VTK, "mesh.vtk", lines=4),
    other("VTU: no XML", "mesh.vtu", "hello\n"),
    other("VTU: an XML bomb", "mesh.vtu", '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">' + "".join(f'<!ENTITY {c} "{f"&{b};" * 10}">' for b, c in zip("abcdefghi", "bcdefghij", strict=True)) + "]><VTKFile>&j;</VTKFile>"),
    other("Gmsh: text", "mesh.msh", "hello\n"),
    other("Gmsh: cut", "mesh.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 9"),
    other("Gmsh: 10^12 nodes", "mesh.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n1000000000000\n1 0 0 0\n$EndNodes\n"),
    other("STL: text", "mesh.stl", "solid\nfacet\n"),
    other("a picture", "mesh.png", b"\x89PNG\r\n\x1a\n"),
    bad("a finer mesh that is not there", put("study/study.yaml", "body.refined", "none.inp"), "none.inp", place="meshed"),
    bad("a finer mesh that is empty", all_of(put("study/study.yaml", "body.refined", "fine.inp"), holds("study/fine.inp", "")), "fine.inp", place="meshed"),
    bad("a finer mesh without the sets", all_of(put("study/study.yaml", "body.refined", "fine.inp"), holds("study/fine.inp", "*NODE\n1, 0., 0.\n2, 1., 0.\n3, 1., 1.\n4, 0., 1.\n*ELEMENT, TYPE=CPE4\n1, 1, 2, 3, 4\n")), "fine.inp", place="meshed", lines=4),
]  # fmt: skip
