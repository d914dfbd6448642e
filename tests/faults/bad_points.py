"""Tables of measured points."""

from battery import NOT_FILES, all_of, bad, either, fine, holds, instead, put, recoded, swap

AREA = "points"
FILE = "study/points.csv"


def text(name, old, new, *says):
    return bad(name, swap(FILE, old, new), *(says or ["points.csv"]), place="points")


def table(name, content, *says):
    return bad(name, holds(FILE, content), *(says or ["points.csv"]), place="points")


CASES = [
    *(bad(name, instead(FILE, make), "points.csv", place="points") for name, make in NOT_FILES.items()),
    table("empty", ""),
    table("head only", "x,y,ux,uy\n"),
    table("no head", "3,3,0.01,-0.2\n"),
    table("bytes", bytes(range(256))),
    table("not UTF-8", "x,y,ux,uy\n3,3,ö,1\n".encode("latin-1")),
    text("a column missing", "x,y,ux,uy", "x,y,ux", "points.csv", "columns"),
    text("a column misspelt", "x,y,ux,uy", "x,y,u,v", "points.csv", "columns"),
    text("columns of a volume", "x,y,ux,uy", "x,y,z,ux,uy,uz", "points.csv", "columns"),
    text("columns in another order", "x,y,ux,uy", "ux,uy,x,y", "points.csv", "columns"),
    text("a cell too many", "3,9,0.01", "3,9,0,0.01", "points.csv", "rows|row|line"),
    text("a cell too few", "3,9,0.01,", "3,9,", "points.csv", "rows|row|line"),
    text("an empty cell", "3,9,0.01,", "3,9,,", "points.csv", "rows|row|line"),
    text("text", "3,9,0.01", "3,9,left", "points.csv", "left"),
    text("NaN", "3,9,0.01", "3,9,nan"),
    text("infinite", "3,9,0.01", "3,9,1e400"),
    text("decimal commas", "3,9,0.01,-0.4", "3;9;0,01;-0,4"),
    either("a point of four beside the body", swap(FILE, "3,9,0.01", "300,9,0.01"), "points.csv", place="points"),
    text("a point that moves out of the body", "3,9,0.01,-0.4", "3,9,0.01,-400"),
    text("a displacement of 1e308", "3,9,0.01,-0.4", "3,9,1e308,-0.4"),
    text("underscores", "3,9,0.01", "3,9,0_0.01"),
    bad("all points beside the body", holds(FILE, "x,y,ux,uy\n300,300,0,0\n301,300,0,0\n"), "points.csv", place="points"),
    bad("no noise of the points and none of the force", put("study/study.yaml", "noise", {"displacement": 0.01}), "noise.points|noise", place="points"),
    bad("a point twice", recoded(FILE, lambda data: data + data.splitlines()[1] + b"\n"), "points.csv", place="points"),
    bad("estimated from different points", all_of(
        put("study/study.yaml", "noise.points", "estimated"),
        holds("study/more.csv", "x,y,ux,uy\n4,4,0,0\n"),
        swap("study/steps.csv", "7,0.1,\n", "7,0.1,more.csv\n"),
    ), "noise.points", place="points"),
    fine("CRLF", recoded(FILE, lambda data: data.replace(b"\n", b"\r\n")), place="points"),
    fine("a byte order mark", recoded(FILE, lambda data: b"\xef\xbb\xbf" + data), place="points"),
    fine("blanks", recoded(FILE, lambda data: data.replace(b",", b" , ")), place="points"),
]  # fmt: skip
