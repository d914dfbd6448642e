"""Pictures: files that are damaged, values that are none, places that do not agree."""

import gzip
import struct

import numpy as np
from battery import NOT_FILES, all_of, bad, either, fine, holds, instead, put, recoded, swap
from places import picture
from seeds import generator

AREA = "pictures"
FIRST, SECOND = "study/before.mha", "study/step_1.mha"
NOISE = generator(5).uniform(0, 4000, (30, 30))
CONFIG = "config.yaml"


def mha(values=None, **header):
    """An uncompressed MetaImage whose header may lie."""
    values = NOISE.astype("<f4") if values is None else values
    lines = {
        "ObjectType": "Image", "NDims": "2", "BinaryData": "True", "BinaryDataByteOrderMSB": "False", "CompressedData": "False",
        "Offset": "-5 -5", "ElementSpacing": "0.8 0.8", "DimSize": "30 30", "ElementType": "MET_FLOAT",
    } | header  # fmt: skip
    text = "".join(f"{key} = {value}\n" for key, value in lines.items() if value is not None)
    return f"{text}ElementDataFile = LOCAL\n".encode() + (values if isinstance(values, bytes) else values.tobytes())


def named(name):
    """The first step's picture under another name."""
    return all_of(
        lambda place: (place / SECOND).rename(place / f"study/{name}"), swap("study/steps.csv", "step_1.mha", name)
    )


def nifti(**header):
    """A NIfTI-1 whose header may lie, by offset."""
    data = bytearray(352 + 4 * 900)
    struct.pack_into("<i", data, 0, 348)
    struct.pack_into("<8h", data, 40, 2, 30, 30, 1, 1, 1, 1, 1)
    struct.pack_into("<2h", data, 70, 16, 32)
    struct.pack_into("<8f", data, 76, 1, 0.8, 0.8, 1, 1, 1, 1, 1)
    struct.pack_into("<f", data, 108, 352)
    data[344:348] = b"n+1\0"
    for offset, (kind, *found) in header.items():
        struct.pack_into(kind, data, int(offset[1:]), *found)
    return bytes(data)


def second(name, content, *says, **more):
    """Another content of the first step's picture."""
    return more.pop("make", bad)(name, holds(SECOND, content), *(says or ["step_1.mha"]), **more)


def other(name, file, content, *says, **more):
    """Another file in place of the first step's picture."""
    change = all_of(holds(f"study/{file}", content), swap("study/steps.csv", "step_1.mha", file))
    return more.pop("make", bad)(name, change, *(says or [file]), **more)


def all_three(**changes):
    def change(place):
        for name in ("before", "step_1", "step_2"):
            picture(place / f"study/{name}.mha", **changes)

    return change


def drawn(**changes):
    return lambda place: picture(place / SECOND, **changes)


SPOT = NOISE.copy()
SPOT[3, 3] = np.nan
HOLE = NOISE.copy()
HOLE[3, 3] = -np.inf
FLAT = np.full((30, 30), 7.0)
LOUD = NOISE.copy()
LOUD[3, 3] = 1e300
SLOPE = np.add.outer(np.arange(30.0), np.arange(30.0))  # details along the diagonals are 0
MANY = "100000 100000"
CASES = [
    *(bad(name, instead(SECOND, make), "step_1.mha") for name, make in NOT_FILES.items()),
    *(bad(f"before compression: {name}", instead(FIRST, make), "before") for name, make in NOT_FILES.items()),
    second("zero bytes", b""),
    second("text", b"hello\n"),
    second("bytes", bytes(range(256)) * 20),
    second("NUL bytes", b"\0" * 5000),
    bad("the data cut in the middle", recoded(SECOND, lambda data: data[: len(data) // 2]), "step_1.mha"),
    bad("the last byte missing", recoded(SECOND, lambda data: data[:-1]), "step_1.mha"),
    bad("the header cut", recoded(SECOND, lambda data: data[:100]), "step_1.mha"),
    bad("compressed data flipped", recoded(SECOND, lambda data: data[:-300] + bytes(b ^ 255 for b in data[-300:])), "step_1.mha"),
    second("uncompressed", mha(), make=fine),
    second("uncompressed and cut", mha()[:-1000]),
    second("uncompressed, without data", mha(b"")),
    second("more data than the header says", mha() + b"x" * 100, make=either),
    second("100000 x 100000 in the header", mha(DimSize=MANY)),
    second("10^9 x 10^9 in the header", mha(DimSize="1000000000 1000000000")),
    bad("100000 x 100000, the first too", all_of(holds(FIRST, mha(DimSize=MANY)), holds(SECOND, mha(DimSize=MANY))), "before.mha"),
    second("0 pixels", mha(DimSize="0 30")),
    second("negative pixels", mha(DimSize="-30 30")),
    second("a size that is text", mha(DimSize="many many")),
    second("no size", mha(DimSize=None)),
    second("one size", mha(DimSize="30")),
    second("no type", mha(ElementType=None)),
    second("an unknown type", mha(ElementType="MET_THING")),
    second("spacing 0", mha(ElementSpacing="0 0.8")),
    second("spacing below 0", mha(ElementSpacing="-0.8 0.8")),
    second("spacing NaN", mha(ElementSpacing="nan 0.8")),
    second("spacing 1e308", mha(ElementSpacing="1e308 0.8")),
    second("origin NaN", mha(Offset="nan -5")),
    second("origin infinite", mha(Offset="inf -5")),
    second("a direction of zeros", mha(TransformMatrix="0 0 0 0")),
    second("a skew direction", mha(TransformMatrix="1 0.4 0 0.9165")),
    second("data in a file that is not there", mha().replace(b"LOCAL", b"none.raw")),
    second("data in a file outside", mha().replace(b"LOCAL", b"/etc/passwd")),
    second("data in itself", mha().replace(b"LOCAL", b"step_1.mha")),
    second("data in a list that is cut", mha().replace(b"LOCAL", b"LIST\nstep_2.mha")),
    bad("NaN", drawn(values=SPOT), "step_1.mha", "NaN"),
    bad("infinite", drawn(values=HOLE), "step_1.mha", "infinite"),
    bad("all NaN", drawn(values=np.full((30, 30), np.nan)), "step_1.mha", "NaN"),
    bad("NaN before compression", lambda place: picture(place / FIRST, values=SPOT), "before.mha", "NaN"),
    bad("constant", drawn(values=FLAT), "step_1.mha"),
    bad("all zero", drawn(values=0 * FLAT), "step_1.mha"),
    bad("constant before compression", lambda place: picture(place / FIRST, values=FLAT), "before.mha"),
    bad("all are constant", all_three(values=FLAT), "before.mha"),
    bad("one pixel of 1e300", drawn(values=LOUD, kind=np.float64), "step_1.mha"),
    bad("complex", drawn(values=NOISE + 1j, kind=np.complex64), "step_1.mha"),
    bad("red, green, blue", drawn(values=np.stack([NOISE] * 3, axis=-1)), "step_1.mha", "3 channels"),
    bad("a vector in each pixel", drawn(values=np.stack([NOISE] * 2, axis=-1)), "step_1.mha", "2 channels"),
    bad("a volume", drawn(shape=(4, 30, 30)), "step_1.mha"),
    bad("volumes for a plane body", all_three(shape=(4, 30, 30)), "before.mha", "3 dimensions"),
    second("four dimensions", mha(np.zeros(16, "<f4"), NDims="4", DimSize="2 2 2 2", Offset="0 0 0 0", ElementSpacing="1 1 1 1")),
    second("one dimension", mha(np.zeros(30, "<f4"), NDims="1", DimSize="30", Offset="0", ElementSpacing="1")),
    second("no dimension", mha(NDims="0")),
    second("99 dimensions", mha(NDims="99")),
    bad("other pixels", drawn(shape=(30, 31)), "step_1.mha", "30 pixels|31x30"),
    bad("another spacing", drawn(spacing=np.full(2, 0.7)), "step_1.mha", "spacing"),
    bad("another origin", drawn(origin=np.full(2, -4.0)), "step_1.mha", "origin"),
    bad("turned", drawn(direction=np.array([[0.0, -1], [1, 0]])), "step_1.mha", "direction"),
    bad("mirrored", all_three(direction=np.diag([1.0, -1.0])), "before.mha"),
    bad("beside the body", all_three(origin=np.full(2, 90.0)), "before.mha", "mesh"),
    bad("in metres", all_three(spacing=np.full(2, 0.0008), origin=np.full(2, -0.005)), "before.mha", "mesh"),
    bad("one pixel", all_three(shape=(1, 1)), "before.mha"),
    bad("one row", all_three(shape=(1, 30)), "before.mha"),
    other("text with the name of a PNG", "step_1.png", b"hello\n"),
    other("a PNG that is cut", "step_1.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x1e"),
    other("a PNG of 100000 x 100000", "step_1.png", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\x01\x86\xa0\0\x01\x86\xa0\x08\0\0\0\0\0\0\0\0"),
    bad("a MetaImage with the name of a PNG", named("step_1.png"), "step_1.png"),
    bad("a MetaImage with the name of a NIfTI", named("step_1.nii"), "step_1.nii"),
    bad("an ending that nobody knows", named("step_1.picture"), "step_1.picture"),
    bad("no ending", named("step_one"), "step_one"),
    other("NIfTI: empty", "step_1.nii", b""),
    other("NIfTI: empty and compressed", "step_1.nii.gz", gzip.compress(b"")),
    other("NIfTI: compressed text", "step_1.nii.gz", gzip.compress(b"no")),
    other("NIfTI: not compressed, but named so", "step_1.nii.gz", nifti()),
    other("NIfTI: cut", "step_1.nii", nifti()[:2000]),
    other("NIfTI: compressed and cut", "step_1.nii.gz", gzip.compress(nifti())[:-40]),
    other("NIfTI: header only", "step_1.nii", nifti()[:348]),
    other("NIfTI: 30000 x 30000 x 30000", "step_1.nii", nifti(_42=("<3h", 30000, 30000, 30000), _40=("<h", 3))),
    other("NIfTI: negative sizes", "step_1.nii", nifti(_42=("<2h", -30, 30))),
    other("NIfTI: an unknown type", "step_1.nii", nifti(_70=("<h", 999))),
    other("NIfTI: NaN as spacing", "step_1.nii", nifti(_80=("<f", float("nan")))),
    other("NIfTI: data at no place", "step_1.nii", nifti(_108=("<f", 1e9))),
    other("NRRD: header only", "step_1.nrrd", b"NRRD0004\ntype: float\ndimension: 2\nsizes: 30 30\nencoding: raw\n\n"),
    other("NRRD: an unknown encoding", "step_1.nrrd", b"NRRD0004\ntype: float\ndimension: 2\nsizes: 30 30\nencoding: zip9\n\n" + b"0" * 3600),
    other("DICOM: text", "step_1.dcm", b"hello\n"),
    other("DICOM: preamble only", "step_1.dcm", b"\0" * 128 + b"DICM"),
    bad("a folder without pictures", all_of(lambda place: (place / "study/series").mkdir(), swap("study/steps.csv", "step_1.mha", "series")), "series"),
    bad("a folder with text as DICOM", all_of(holds("study/series/a.dcm", b"hello\n"), swap("study/steps.csv", "step_1.mha", "series")), "series"),
    fine("no background: noise is estimated from the finest details", all_of(put("study/study.yaml", "body.width", 23), put("study/study.yaml", "body.origin", [-5, -5]), put("study/study.yaml", "body.layers.0.height", 17))),
    bad("no noise to be estimated: details without any", all_of(
        *(put("study/study.yaml", key, value) for key, value in {"body.width": 23, "body.origin": [-5, -5], "body.layers.0.height": 17}.items()),
        lambda place: [picture(place / f"study/{name}.mha", values=SLOPE + n) for n, name in enumerate(("before", "step_1", "step_2"))],
        put(CONFIG, "fit.score", "likelihood"),
    ), "pictures.noise"),
    bad("scale: off, with intensities to 4000", put("study/study.yaml", "pictures.scale", "off"), "pictures.scale"),
    bad("a volume is a plane", lambda place: picture(place / SECOND), "step_1.mha", place="volume"),
    bad("a volume of NaN", lambda place: picture(place / SECOND, values=np.full((12, 14, 16), np.nan), origin=np.full(3, -2.0)), "step_1.mha", place="volume"),
    bad("a volume of other voxels", lambda place: picture(place / SECOND, (12, 14, 15), origin=np.full(3, -2.0)), "step_1.mha", place="volume"),
    bad("a left-handed volume", lambda place: picture(place / SECOND, (12, 14, 16), origin=np.full(3, -2.0), direction=np.diag([1.0, 1, -1])), "step_1.mha", place="volume"),
    bad("a constant volume", lambda place: picture(place / SECOND, values=np.full((12, 14, 16), 3.0), origin=np.full(3, -2.0)), "step_1.mha", place="volume"),
]  # fmt: skip
