"""steps.csv: columns, cells, order, and text that is no table."""

import os

from battery import NOT_FILES, bad, either, fine, holds, instead, recoded, swap

AREA = "steps.csv"
FILE = "study/steps.csv"
HEAD = "step,time,displacement,force,picture\n"


def cell(column, old, *found, **more):
    """Values in a cell of the second step, whose cells are 2, 2, 1.0, 14 and step_2.mha."""
    row = {
        "step": "{},2,1.0,14,",
        "time": "2,{},1.0,14,",
        "displacement": "2,2,{},14,",
        "force": "2,2,1.0,{},",
        "picture": "2,2,1.0,14,{}",
    }[column]
    make, says = more.pop("make", bad), more.pop("says", ("steps.csv", column))
    return [
        make(f"{column}: {text!r}"[:60], swap(FILE, row.format(old), row.format(text)), *says, **more) for text in found
    ]


def table(name, content, *says, **more):
    return more.pop("make", bad)(name, holds(FILE, content), *(says or ("steps.csv",)), **more)


CASES = [
    *cell("step", "2", "", "1", "0", "-2", "2.5", "two", "1e9", "99999999999", "nan", "²"),
    *cell("time", "2", "1", "0.5", "nan", "inf", "2 s", "-1"),
    *cell("time", "2", "1e400", "0x2", "1_0"),
    *cell("displacement", "1.0", "nan", "-1.0", "1 mm", "inf", "1e999", "one"),
    *cell("force", "14", "", says=["step 2 without force"]),
    *cell("force", "14", "nan", "NaN", "inf", "-inf", "-14", "14N", "14 N", "1_4", "0x1A", "None", "#REF!", "=A1", "true"),
    *cell("force", "14", "14,0", '"14', says=["steps.csv", "row 3"]),
    *cell("force", "14", "1e308"),  # finite, and no force of a body of 12 mm
    *cell("force", "14", "7" * (1 << 20), says=["steps.csv"]),
    *cell("force", "14", "\x00", says=["steps.csv"]),
    *cell("force", "14", " 14 ", '"14"', "1.4e1", "+14", make=fine),
    *cell("displacement", "1.0", "", make=fine),  # measured beside the control
    *cell("picture", "step_2.mha", "none.mha", ".", "../study", "step_2.mha\x07", "a" * 300, "step_2.mha;rm -rf x", says=["steps.csv|study"]),
    *cell("picture", "step_2.mha", "steps.csv", "study.yaml", says=["steps.csv|study.yaml"]),
    *cell("picture", "step_2.mha", "step_1.mha", says=["steps.csv: picture: found step_1.mha at steps 1 and 2"]),
    *cell("picture", "step_2.mha", "", says=["fit.steps", "step 2"]),
    bad("a cell too many", swap(FILE, "\n2,2,1.0", "\n2,2,2,1.0"), "steps.csv", "row 3"),
    bad("a cell too few", swap(FILE, "\n2,2,1.0", "\n2,1.0"), "steps.csv", "row 3"),
    bad("no column step", swap(FILE, "step,time", "number,time"), "steps.csv", "columns"),
    bad("a column twice", swap(FILE, "step,time", "step,force"), "steps.csv", "columns"),
    bad("a column misspelt", swap(FILE, "displacement,", "displacment,"), "steps.csv", "columns", "displacment"),
    bad("a column with its unit", swap(FILE, ",force,", ",force [N],"), "steps.csv", "columns", "force \\[N\\]"),
    bad("a column that nobody knows", swap(FILE, ",picture", ",picture,colour"), "steps.csv", "colour"),
    bad("a column without name", swap(FILE, ",force,", ",,"), "steps.csv", "columns"),
    bad("no column of the control", holds(FILE, "step,displacement,picture\n1,0.5,step_1.mha\n2,1.0,step_2.mha\n"), "force"),
    table("empty", ""),
    table("blank lines only", "\n\n,,,\n"),
    table("head without rows", HEAD, "steps.csv", "rows"),
    table("rows without head", "1,1,0.5,7,step_1.mha\n2,2,1.0,14,step_2.mha\n", "steps.csv", "columns"),
    table("semicolons", HEAD.replace(",", ";") + "1;1;0,5;7;step_1.mha\n", "steps.csv", "columns"),
    table("tabs", HEAD.replace(",", "\t") + "1\t1\t0.5\t7\tstep_1.mha\n", "steps.csv", "columns"),
    table("one long line", HEAD.replace("\n", ","), "steps.csv"),
    table("YAML", "steps:\n- 1\n", "steps.csv", "columns"),
    table("bytes of a picture", bytes(range(256)) * 9),
    table("NUL bytes", b"\0" * 4096),
    table("UTF-16", (HEAD + "1,1,0.5,7,step_1.mha\n").encode("utf-16")),
    table("an open quote", HEAD + '1,1,0.5,7,"step_1.mha\n2,2,1.0,14,step_2.mha\n'),
    table("100 000 columns", ",".join(["step", *["x"] * 100_000]) + "\n"),
    table("a head of 1 MB", "x" * (1 << 20) + "\n"),
    table("steps in reverse", HEAD + "2,2,1.0,14,step_2.mha\n1,1,0.5,7,step_1.mha\n", "steps.csv", "row 3, step"),
    table("a step twice", HEAD + "1,1,0.5,7,step_1.mha\n1,2,1.0,14,step_2.mha\n", "steps.csv", "row 3, step"),
    bad("not UTF-8", recoded(FILE, lambda data: data + "3,3,1.5,21,größe.mha\n".encode("latin-1")), "steps.csv"),
    fine("a byte order mark", recoded(FILE, lambda data: b"\xef\xbb\xbf" + data)),
    fine("CRLF", recoded(FILE, lambda data: data.replace(b"\n", b"\r\n"))),
    fine("blank lines between", recoded(FILE, lambda data: data.replace(b"\n", b"\n\n"))),
    either("CR alone", recoded(FILE, lambda data: data.replace(b"\n", b"\r")), "steps.csv"),
    bad("no last line feed, cut in a row", recoded(FILE, lambda data: data[:-14]), "steps.csv", "row 3"),
    *(bad(name, instead(FILE, make), "steps.csv") for name, make in NOT_FILES.items()),
    bad("no permission", lambda place: (place / FILE).chmod(0), "steps.csv") if os.getuid() else
    bad("no folder of that name", lambda place: (place / FILE).rename(place / "steps.csv"), "steps.csv"),
    either("a force of 0", swap(FILE, "1,1,0.5,7,", "1,1,0.5,0,"), "force"),
    *(
        bad(f"displacement {found} mm in a body of 12 mm", swap(FILE, ",1.0,14", f",{found},14"), "displacement", place="points")
        for found in ("13", "1e6", "1e308")
    ),
    bad("force_noise of 0", swap(FILE, "14,0.1", "14,0"), "steps.csv", "force_noise", place="points"),
    bad("force_noise below 0", swap(FILE, "14,0.1", "14,-0.1"), "steps.csv", "force_noise", place="points"),
    bad("nothing measured", holds(FILE, "step,displacement\n1,0.5\n"), "nothing measured|fit.steps|steps", place="points"),
]  # fmt: skip
