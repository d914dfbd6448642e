"""Pictures that are cut, damaged, without content or repeated: one line each, from `fingerfit check`, before anything is fitted."""

from __future__ import annotations

import gzip
import struct
import zlib

import numpy as np
import pytest
import yaml
from seeds import generator

from fingerfit.cli import main
from fingerfit.imaging.pictures import Picture, read_picture, write_picture

SHAPE = (30, 32)


def shown(name, shape=SHAPE):
    """Intensities of a picture: smooth, with noise of its own, and moved from step to step."""
    push = {"before": 0.0, "step_1": 1.0, "step_2": 2.0}.get(name, 0.0)
    *_, y, x = np.indices(shape, dtype=float)
    noise = generator(sum(name.encode())).normal(0.0, 20.0, shape)
    return np.rint(2000 + 1500 * np.sin(0.5 * (y + push)) * np.sin(0.4 * x) + noise)


def frame(dim=2):
    return {"spacing": np.full(dim, 0.8), "origin": np.full(dim, -5.0), "direction": np.eye(dim)}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A study whose pictures have the ending that the case wants, and its config."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def make(place, ending, kind=np.uint16, shape=SHAPE):
    study = place / "study"
    for name in ("before", "step_1", "step_2"):
        write_picture(
            study / f"{name}{ending}",
            Picture(
                shown(name, shape),
                **{**frame(len(shape)), "origin": np.full(len(shape), -5.0 if len(shape) == 2 else -2.0)},
            ),
            kind,
        )
    (study / "steps.csv").write_text(
        f"step,displacement,force,picture\n1,0.5,7,step_1{ending}\n2,1.0,14,step_2{ending}\n"
    )
    plane = {"width": 12, "thickness": 70, "layers": [{"name": "body", "height": 12}]}
    data = {
        "title": "t",
        "units": {"length": "mm", "force": "N", "time": "s"},
        "control": "force",
        "steps": "steps.csv",
        "pictures": {"before": f"before{ending}", "noise": 20.0},
        "noise": {"force": 0.1, "displacement": 0.01},
        "body": plane if len(shape) == 2 else {"brick": [8, 7, 6], "layers": [{"name": "body"}]},
        "boundary": {"base": "held", "indenter": "glued"},
    }
    (study / "study.yaml").write_text(yaml.safe_dump(data))
    config = {
        "study": "study",
        "model": {
            "material": {"alpha": 1.4, "poisson": 0.45},
            "mesh": {"element": "CPE4" if len(shape) == 2 else "C3D8", "across": 2, "per_layer": 2},
            "parameters": {"mu": {"unit": "MPa", "start": 0.1, "lower": 0.01, "upper": 1.0}},
        },
        "fit": {"score": "nmi", "stages": [{"name": "s", "kind": "independent"}]},
    }
    (place / "config.yaml").write_text(yaml.safe_dump(config))


def cut(share):
    """A file of which the end is missing: a share, or a number of bytes."""
    return lambda raw: raw[: int(len(raw) * share)] if isinstance(share, float) else raw[:-share]


def flip(at):
    def change(raw):
        n = int(len(raw) * at)
        return raw[:n] + bytes([raw[n] ^ 0x55]) + raw[n + 1 :]

    return change


def header(*fields):
    """NIfTI-1 with other fields: offset, format, value."""

    def change(raw):
        data = bytearray(raw)
        for at, form, value in fields:
            struct.pack_into("<" + form, data, at, value)
        return bytes(data)

    return change


def swap(old, new):
    def change(raw):
        assert old in raw
        return raw.replace(old, new, 1)

    return change


def packed(change):
    return lambda raw: gzip.compress(change(gzip.decompress(raw)))


def zeros_after(share):
    return lambda raw: raw[: int(len(raw) * share)] + bytes(len(raw) - int(len(raw) * share))


PIXEL = 352 + 4 * 100
NOT_A_NUMBER = struct.pack("<f", np.nan)
INFINITE = struct.pack("<f", np.inf)
WIDTH, TYPE, BITS, PIXDIM, OFFSET, SLOPE, SHIFT = 42, 70, 72, 80, 108, 112, 116
# ending of the files, change of the file, beginning of the line after the file's name
FILES = {
    "nii.gz cut in half": (".nii.gz", cut(0.5), "picture: found gzip that ends in the middle; expected a whole file"),
    "nii.gz without its last bytes": (".nii.gz", cut(4), "picture: found gzip that ends in the middle"),
    "nii.gz without its trailer": (".nii.gz", cut(8), "picture: found gzip that ends in the middle"),
    "nii.gz with a wrong checksum": (".nii.gz", lambda raw: raw[:-8] + bytes(4) + raw[-4:], "picture: found damaged gzip (CRC check failed"),
    "nii.gz with a wrong size": (".nii.gz", lambda raw: raw[:-4] + bytes(4), "picture: found damaged gzip (Incorrect length"),
    "nii.gz of zeros from the middle on": (".nii.gz", zeros_after(0.6), "picture: found gzip that ends in the middle"),
    "nii.gz of a file that was cut": (".nii.gz", packed(cut(0.7)), "picture: found 1590 bytes; expected 2272 bytes for 32 x 30 pixels of 16 bits"),
    "nii.gz of a file that was cut by a byte": (".nii.gz", packed(cut(1)), "picture: found 2271 bytes; expected 2272 bytes for"),
    "nii.gz of a file with more rows": (".nii.gz", packed(lambda raw: raw + raw[-64:]), "picture: found 2336 bytes or more; expected 2272 bytes for"),
    "empty nii.gz": (".nii.gz", lambda raw: b"", "picture: found"),
    "nii cut in half": (".nii", cut(0.5), "picture: found 1136 bytes; expected 2272 bytes for 32 x 30 pixels of 16 bits"),
    "nii cut by a byte": (".nii", cut(1), "picture: found 2271 bytes; expected 2272 bytes for"),
    "nii of a header alone": (".nii", lambda raw: raw[:352], "picture: found 352 bytes; expected 2272 bytes for"),
    "nii of half a header": (".nii", lambda raw: raw[:200], "picture: found"),
    "nii that promises more": (".nii", header((WIDTH, "h", 3000)), "picture: found 2272 bytes; expected 180352 bytes for 3000 x 30"),
    "nii whose pixels begin elsewhere": (".nii", header((OFFSET, "f", 1e6)), "picture: found 2272 bytes; expected 1001920 bytes"),
    "nii of no offset": (".nii", header((OFFSET, "f", np.nan)), "vox_offset: found nan; expected 348 or more"),
    "nii of spacing 0": (".nii", header((PIXDIM, "f", 0.0)), "pixdim: found 0 0.8; expected lengths of a pixel above 0"),
    "nii of spacing NaN": (".nii", header((PIXDIM + 4, "f", np.nan)), "pixdim: found 0.8 nan"),
    "nii of infinite spacing": (".nii", header((PIXDIM, "f", np.inf)), "pixdim: found inf 0.8"),
    "nii of negative spacing": (".nii", header((PIXDIM, "f", -0.8)), "pixdim: found -0.8 0.8"),
    "nii in metres": (".nii", header((123, "B", 1)), "geometry: found spacing [800.000012, 800.000012], origin"),
    "nii in micrometres": (".nii", header((123, "B", 3)), "geometry: found spacing [0.0008, 0.0008], origin"),
    "nii of another code": (".nii", header((TYPE, "h", 77)), "datatype: found code 77 with 16 bits"),
    "nii of other bits": (".nii", header((BITS, "h", 8)), "datatype: found code 512 with 8 bits; expected 16 bits"),
    "nii of complex numbers": (".nii", header((TYPE, "h", 32), (BITS, "h", 64)), "datatype: found complex intensities"),
    "nii of slope NaN": (".nii", header((SLOPE, "f", np.nan)), "scl_slope: found nan, scl_inter 0; expected finite numbers"),
    "nii of shift NaN": (".nii", header((SLOPE, "f", 2.0), (SHIFT, "f", np.nan)), "scl_slope: found 2, scl_inter nan"),
    "nii without its magic": (".nii", header((344, "4s", b"xxxx")), "magic: found 'xxxx'; expected n+1 or n+2"),
    "nii of a place that is NaN": (".nii", header((280, "f", np.nan)), "sform: found nan"),
    "nii of a size below 0": (".nii", header((WIDTH, "h", -32)), "dim: found 2 -32 30"),
    "NaN in float nii": (".nii:f", lambda raw: raw[:PIXEL] + NOT_A_NUMBER + raw[PIXEL + 4 :], "picture: found NaN or infinite intensities"),
    "infinity in float nii": (".nii:f", lambda raw: raw[:PIXEL] + INFINITE + raw[PIXEL + 4 :], "picture: found NaN or infinite intensities"),
    "NaN in float nii.gz": (".nii.gz:f", packed(lambda raw: raw[:PIXEL] + NOT_A_NUMBER + raw[PIXEL + 4 :]), "picture: found NaN or infinite intensities"),
    "NaN as the last pixel of float nii.gz": (".nii.gz:f", packed(lambda raw: raw[:-4] + NOT_A_NUMBER), "picture: found NaN or infinite intensities"),
    "mha cut": (".mha", cut(0.9), "picture: found zlib that ends in the middle"),
    "mha cut by a byte": (".mha", cut(1), "picture: found zlib that ends in the middle"),
    "mha with a changed byte": (".mha", flip(0.7), "picture: found damaged zlib"),
    "mha of spacing NaN": (".mha", swap(b"ElementSpacing = 0.8", b"ElementSpacing = nan 0.8"), "elementspacing: found nan 0.8"),
    "mha of negative spacing": (".mha", swap(b"ElementSpacing = 0.8", b"ElementSpacing = -.8"), "elementspacing: found -.8"),
    "mha of a place that is NaN": (".mha", swap(b"Offset = -5", b"Offset = nan"), "offset: found nan -5; expected finite numbers"),
    "plain mha cut": (".mha:plain", cut(2), "picture: found"),
    "nrrd cut": (".nrrd", cut(0.9), "picture: found gzip that ends in the middle"),
    "nrrd with a wrong checksum": (".nrrd", lambda raw: raw[:-8] + bytes(4) + raw[-4:], "picture: found damaged gzip (CRC"),
    "nrrd of directions that are NaN": (".nrrd", swap(b"(0.8", b"(nan,0.8"), "space directions: found"),
    "png cut": (".png", cut(0.9), "picture: found"),
    "png with a changed byte": (".png", flip(0.6), "picture: found"),
    "tif cut by a byte": (".tif", cut(1), "picture: found"),
    "tif cut in half": (".tif", cut(0.5), "picture: found"),
    "bmp cut": (".bmp:b", cut(0.9), "picture: found"),
    "jpg cut": (".jpg:b", cut(0.6), "picture: found no end marker; expected a whole file"),
    "a format without a check": (".vtk", lambda raw: raw, "picture: found a file for VTKImageIO; expected a format in which damage can be told"),
    "a page of the web": (".nii.gz", lambda raw: b"<html>404</html>", "picture: found"),
}  # fmt: skip
KINDS = {"": np.uint16, "f": np.float32, "b": np.uint8, "plain": np.uint16}


def told(capsys):
    return [line for line in capsys.readouterr().err.splitlines() if line.startswith("fingerfit: ")]


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_told(place, name, capfd):
    form, change, expected = FILES[name]
    ending, _, kind = form.partition(":")
    make(place, ending, KINDS[kind])
    if kind == "plain":
        plain(place / "study/step_2.mha")
    if ending not in (".vtk", ".bmp"):  # the one is not taken, the other has three channels
        assert np.isfinite(read_picture(place / f"study/step_2{ending}").values).all()
    path = place / f"study/step_2{ending}"
    path.write_bytes(change(path.read_bytes()))
    if ending in (".png", ".bmp", ".jpg", ".tif", ".vtk"):  # formats without a place: alone
        from fingerfit.core.errors import InputError

        with pytest.raises(InputError) as caught:
            read_picture(path)
        assert str(caught.value).startswith(f"{path}: {expected}")
        assert "\n" not in str(caught.value)
        return
    assert main(["check", "study"]) == 1
    lines = told(capfd)
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"fingerfit: error: study/step_2{ending}: {expected}")


def plain(path):
    """The same picture, not compressed."""
    import SimpleITK as sitk

    sitk.WriteImage(sitk.ReadImage(str(path)), str(path), useCompression=False)


def of(name, values, kind=np.uint16):
    return lambda place: write_picture(place / f"study/{name}.nii.gz", Picture(values, **frame(values.ndim)), kind)


def copy(source, target):
    return lambda place: (place / f"study/{target}").write_bytes((place / f"study/{source}").read_bytes())


def complex_picture(place):
    import SimpleITK as sitk

    image = sitk.GetImageFromArray(shown("step_2") + 1j * shown("step_1"))
    sitk.WriteImage(image, str(place / "study/step_2.nrrd"))
    steps = place / "study/steps.csv"
    steps.write_text(steps.read_text().replace("step_2.nii.gz", "step_2.nrrd"))


def shown_twice(place):
    steps = place / "study/steps.csv"
    steps.write_text(steps.read_text().replace("step_2.nii.gz", "step_1.nii.gz"))


def repeats(*names):
    def change(place):
        path = place / "study/study.yaml"
        data = yaml.safe_load(path.read_text())
        data["pictures"]["noise"] = list(names)
        path.write_text(yaml.safe_dump(data))

    return change


def in_units(name):
    def change(place):
        for each in ("before", "step_1", "step_2"):
            path = place / f"study/{each}.nii.gz"
            path.write_bytes(packed(header((123, "B", name)))(path.read_bytes()))

    return change


CONTENTS = {
    "all zero": (of("step_2", np.zeros(SHAPE)), "step_2.nii.gz: picture: found all pixels 0; expected a picture that shows the body"),
    "constant": (of("step_1", np.full(SHAPE, 7.0)), "step_1.nii.gz: picture: found all pixels 7; expected a picture that shows the body"),
    "nothing before compression": (of("before", np.zeros(SHAPE)), "before.nii.gz: picture: found all pixels 0"),
    "a step again": (copy("step_1.nii.gz", "step_2.nii.gz"), "step_2.nii.gz: picture: found the pixels of step_1.nii.gz; expected a picture of its own"),
    "a step named twice": (shown_twice, "steps.csv: picture: found step_1.nii.gz at steps 1 and 2; expected a picture of its own"),
    "the picture before compression again": (copy("before.nii.gz", "step_1.nii.gz"), "step_1.nii.gz: picture: found the pixels of before.nii.gz"),
    "the same pixels in other bytes": (of("step_2", shown("step_1"), np.float32), "step_2.nii.gz: picture: found the pixels of step_1.nii.gz"),
    "a repetition without noise": (lambda p: [copy("before.nii.gz", "again.nii.gz")(p), repeats("again.nii.gz")(p)], "again.nii.gz: picture: found the pixels of before.nii.gz; expected a repetition"),
    "complex": (complex_picture, "step_2.nrrd: picture: found complex intensities; expected real ones"),
    "another file of the name without gz": (copy("step_1.nii.gz", "step_2.nii"), "step_2.nii.gz: picture: found step_2.nii beside it, whose pixels ITK would take"),
    "all in metres": (in_units(1), "before.nii.gz: picture: found 0.015 x 0.015 pixels for the whole body; expected 2 or more"),
    "all in micrometres": (in_units(3), "before.nii.gz: picture: found 11 % of the mesh in it (mesh 0 to 12, 0 to 12 mm; picture -0.0054 to"),
}  # fmt: skip


@pytest.mark.parametrize("name", CONTENTS)
def test_what_a_picture_shows_is_looked_at(place, name, capsys):
    make(place, ".nii.gz")
    change, expected = CONTENTS[name]
    change(place)
    assert main(["check", "study"]) == 1
    lines = told(capsys)
    assert len(lines) == 1, lines
    assert lines[0].startswith(f"fingerfit: error: study/{expected}")


HELD_OUT = CONTENTS | {
    "text": (lambda p: (p / "study/step_2.nii.gz").write_text("hello"), "step_2.nii.gz: picture: found"),
    "another size": (of("step_2", shown("step_2")[:20]), "step_2.nii.gz: geometry: found 32x20 pixels; expected that of"),
    "a volume": (of("step_2", np.stack([shown("step_2")] * 3)), "step_2.nii.gz: geometry: found 32x30x3 pixels"),
}  # fmt: skip


@pytest.mark.parametrize("name", [n for n, (_, line) in HELD_OUT.items() if line.startswith(("step_2", "steps"))])
def test_a_picture_that_is_held_out_is_looked_at(place, name, capsys):
    """By check and by the first job of a fit: the diagnosis compares it."""
    make(place, ".nii.gz")
    config = yaml.safe_load((place / "config.yaml").read_text())
    (place / "config.yaml").write_text(yaml.safe_dump({**config, "fit": {**config["fit"], "steps": [1]}}))
    change, expected = HELD_OUT[name]
    change(place)
    for line in (["check", "study"], ["prepare", "config.yaml", "--out", "data.npz", "--mesh", "mesh.inp"]):
        assert main(line) == 1
        lines = told(capsys)
        assert len(lines) == 1, lines
        assert lines[0].startswith(f"fingerfit: error: study/{expected}")


def test_a_slice_that_is_cut_at_the_end_of_a_series(place, capsys):
    """GDCM leaves it out, and the volume would only be lower."""
    from test_bad_volumes import EVEN, series

    make(place, ".mha", shape=(12, 14, 16))
    series(place, "before", EVEN)
    last = place / "study/before/1.2.3.4_11.dcm"
    last.write_bytes(last.read_bytes()[:90])
    path = place / "study/study.yaml"
    path.write_text(path.read_text().replace("before.mha", "before"))
    assert main(["check", "study"]) == 1
    (line,) = told(capsys)
    assert "before: slices: found 1.2.3.4_11.dcm, which is no slice of the series" in line


@pytest.mark.parametrize("ending", [".nii", ".nii.gz", ".mha", ".nrrd"])
@pytest.mark.parametrize("shape", [SHAPE, (12, 14, 16)])
def test_whole_pictures_are_fine_and_in_order(place, ending, shape, capsys):
    make(place, ending, np.float32, shape)
    assert main(["check", "study"]) == 0, capsys.readouterr().err
    assert "remark" not in capsys.readouterr().out


def test_a_large_file_is_looked_through_in_blocks(place, monkeypatch):
    """NaN and the end are found wherever the borders of the blocks are."""
    from fingerfit.core.errors import InputError
    from fingerfit.imaging import whole

    make(place, ".nii.gz", np.float32)
    path = place / "study/step_1.nii.gz"
    raw = gzip.decompress(path.read_bytes())
    for block in (1, 7, 64, 541, 4096):
        monkeypatch.setattr(whole, "BLOCK", block)
        path.write_bytes(gzip.compress(raw))
        read_picture(path)
        path.write_bytes(gzip.compress(raw[:PIXEL] + NOT_A_NUMBER + raw[PIXEL + 4 :]))
        with pytest.raises(InputError, match="NaN"):
            read_picture(path)
        path.write_bytes(gzip.compress(raw[:-1]))
        with pytest.raises(InputError, match="bytes"):
            read_picture(path)


@pytest.mark.parametrize("ending", [".nii", ".nii.gz", ".hdr", ".mha", ".nrrd", ".tif", ".bmp"])
def test_whatever_bytes_there_are_it_is_one_line(place, ending):
    """Bytes of the header changed and ends cut at random: told as an error of the file, or not at all."""
    from fingerfit.core.errors import InputError
    from fingerfit.imaging.whole import refuse_damaged

    make(place, ending, np.uint8 if ending == ".bmp" else np.float32)
    path = place / f"study/step_1{ending}"
    raw, rng = path.read_bytes(), generator(3)
    told = 0
    for trial in range(300):
        data = bytearray(raw)
        for _ in range(rng.integers(1, 6)):
            data[rng.integers(-300, min(len(data), 600))] = rng.integers(0, 256)  # headers, and TIFF's at the end
        path.write_bytes(bytes(data[: rng.integers(0, len(data))] if trial % 3 == 0 else data))
        try:
            refuse_damaged(path)
        except InputError as error:
            assert "\n" not in str(error)
            told += 1
    assert told > 0


def test_a_zlib_stream_of_two_blocks_is_whole(place):
    """The checksum is looked at in blocks that end anywhere."""
    make(place, ".mha", shape=(40, 60, 70))
    raw = (place / "study/before.mha").read_bytes()
    assert len(zlib.decompress(raw[raw.index(b"LOCAL\n") + 6 :])) == 2 * 40 * 60 * 70
    assert read_picture(place / "study/before.mha").values.shape == (40, 60, 70)
