"""YAML that is none, text in other encodings, and what is no file at all."""

import os

from battery import CHECK, NOT_FILES, all_of, bad, either, fine, holds, instead, recoded

AREA = "YAML files"
BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefghij", "bcdefghijk", strict=True)
)
EXPERIMENT = ("experiment", "experiment.yaml", "--out", "made")
FINGER = ("finger", "--anatomy", "anatomy.yaml", "--size", "20", "--element", "C3D4", "--out", "finger.inp")
COMMANDS = {
    "study/study.yaml": CHECK,
    "config.yaml": CHECK,
    "study/effects/own.yaml": CHECK,
    "experiment.yaml": EXPERIMENT,
    "anatomy.yaml": FINGER,
}
DAMAGES = {
    "empty": b"",
    "a comment only": b"# nothing\n",
    "a list": b"- 1\n- 2\n",
    "a text": b"hello\n",
    "a number": b"3\n",
    "a list that is not closed": b"a: [1,\n",
    "a quote that is not closed": b"title: 'a\n",
    "a tab": b"a:\n\tb: 1\n",
    "wrong indentation": b"a: 1\n  b: 2\n",
    "a key without colon": b"title t\nsteps: 1\n",
    "two documents": b"a: 1\n---\nb: 2\n",
    "an alias that is not defined": b"a: *b\n",
    "a tag that would run": b"title: !!python/object/apply:os.mkdir [ran]\n",
    "an unknown tag": b"title: !mine 3\n",
    "a NUL byte": b"title: a\0b\n",
    "a control character": b'title: "a\x07b"\n',
    "not UTF-8": "title: größe\n".encode("latin-1"),
    "bytes": bytes(range(256)) * 4,
    "a list as key": b"? [a, b]\n: 1\n",
    "a number of 10 000 digits": b"title: " + b"9" * 10_000 + b"\n",
    "no date": b"title: 2024-99-99\n",
}
# added to what is there
HEAVY = {
    "an alias bomb": (BOMB.replace("\n", "\n  ").replace("a: &a", "more:\n  a: &a") + "z: *k\n").encode(),
    "a list in itself": b"more: &a [*a]\n",
    "1000 brackets": b"more: " + b"[" * 1000 + b"]" * 1000 + b"\n",
    "100 000 brackets": b"more: " + b"[" * 100_000,
    "20 MB of one word": b"more: " + b"x" * 20_000_000 + b"\n",
}


def _key_twice(data: bytes) -> bytes:
    """The last key of the file once more; YAML that was dumped has the short ones in one line."""
    keys = [line for line in data.splitlines() if line[:1].isalpha()]
    return data + keys[-1].partition(b":")[0] + b": again\n"


CASES = [
    *(
        bad(f"{name}: {damage}", holds(file, content), name, command=command)
        for file, command in COMMANDS.items()
        for name in [file.rpartition("/")[2]]
        for damage, content in DAMAGES.items()
    ),
    *(
        bad(f"{name}: {damage}", recoded(file, lambda data, content=content: data + content), name, command=command)
        for file, command in (("study/study.yaml", CHECK), ("config.yaml", CHECK))
        for name in [file.rpartition("/")[2]]
        for damage, content in HEAVY.items()
    ),
    *(
        bad(f"{name}: {kind}", instead(file, make), name, command=command)
        for file, command in COMMANDS.items()
        for name in [file.rpartition("/")[2]]
        for kind, make in NOT_FILES.items()
        if (file, kind) != ("study/effects/own.yaml", "no such file")  # then there is no effect
    ),
    *(bad(f"{file.rpartition('/')[2]}: a key twice", recoded(file, _key_twice), file.rpartition("/")[2], "twice", command=command)
      for file, command in COMMANDS.items()),
    *(fine(f"{file.rpartition('/')[2]}: a byte order mark", recoded(file, lambda data: b"\xef\xbb\xbf" + data), command=command)
      for file, command in COMMANDS.items()),
    *(fine(f"{file.rpartition('/')[2]}: CRLF", recoded(file, lambda data: data.replace(b"\n", b"\r\n")), command=command)
      for file, command in COMMANDS.items()),
    *(either(f"{file.rpartition('/')[2]}: UTF-16", recoded(file, lambda data: data.decode().encode("utf-16")), file.rpartition("/")[2], command=command)
      for file, command in COMMANDS.items()),
    *(fine(f"{file.rpartition('/')[2]}: a document mark", recoded(file, lambda data: b"---\n" + data + b"...\n"))
      for file in ("study/study.yaml", "config.yaml")),
    *(bad(f"{file.rpartition('/')[2]}: no permission", lambda place, file=file: (place / file).chmod(0), "Permission", command=command)
      for file, command in COMMANDS.items() if os.getuid()),
    fine("anchors that are used", all_of(holds("anatomy.yaml", b"length: &l 34.0\nwidth: 16\nepidermis: 0.68\n")), command=FINGER),
]  # fmt: skip
