"""Solvers that crash, hang or write nonsense, and those that are not there."""

import json
import os
import re
from unittest import mock

import battery
from battery import all_of, bad, fine, holds, nothing, recoded

from fingerfit.solvers import abaqus as abaqus_adapter
from fingerfit.solvers import calculix
from fingerfit.solvers.registry import get_solver

AREA = "solvers"
DAT, FIL, SAID = "ready.dat", "ready.fil", "said.txt"
OURS = {
    "calculix": ("calculix.json", {"FINGERFIT_CCX": "{place}/ccx"}),
    "abaqus": ("abaqus.json", {"FINGERFIT_ABAQUS": "{place}/abaqus job={job} cpus={threads}"}),
}


def asked(place):
    """The programs with the folder of what they give, and what the workflow writes of them."""
    for name, (file, environment) in OURS.items():
        program = place / ("ccx" if name == "calculix" else name)
        program.write_text(program.read_text(encoding="utf-8").replace("{0}", str(place)), encoding="utf-8")
        with mock.patch.dict(os.environ, battery.placed(environment, place)):
            (place / file).write_text(json.dumps(get_solver(name).identity()))
    calculix._version.cache_clear()  # else the command, a fork of this process, would know it
    abaqus_adapter._version.cache_clear()


def solve(solver, name, change, *says, make=bad, **more):
    file, environment = OURS[solver]
    command = ("simulate", "deck.inp", "--solver", file, "--out", "s.npz")
    return make(f"{solver}: {name}", all_of(asked, change), *(says or [solver]), place="deck", command=command,
                **{"environment": environment} | more)  # fmt: skip


def ccx(name, change, *says, **more):
    return solve("calculix", name, change, *says, **more)


def abaqus(name, change, *says, **more):
    return solve("abaqus", name, change, *says, **more)


def program(name, text):
    """Another program."""
    version = 'if [ "$1" = -v ]; then echo "This is Version 2.20"; exit 0; fi\n'
    release = 'if [ "$1" = information=release ]; then echo "Abaqus 2024"; exit 0; fi\n'

    def change(place):
        (place / name).write_text(
            "#!/bin/sh\n" + (version if name == "ccx" else release) + text.replace("{0}", str(place))
        )
        (place / name).chmod(0o755)

    return change


def edit(file, old, new):
    def changed(data):
        found, count = re.subn(old, new, data, count=1, flags=re.DOTALL)
        assert count, f"{old!r} is not in {file}"
        return found

    return recoded(file, changed)


NUMBER = rb"-?\d\.\d{6}E[+-]\d\d"
ROW = rb"\n +5 +(" + NUMBER + rb") +(" + NUMBER + rb")"
CASES = [
    ccx("the results that lie ready", nothing, make=fine),
    abaqus("the results that lie ready", nothing, make=fine),
    ccx("a program beside the study, by a relative path", nothing, make=fine, environment={"FINGERFIT_CCX": "./ccx"}),
    ccx("NaN in a displacement", edit(DAT, ROW, rb"\n 5 NaN \2")),
    ccx("all NaN", recoded(DAT, lambda data: re.sub(NUMBER, b"NaN", data))),
    ccx("infinite displacement", edit(DAT, ROW, rb"\n 5 Infinity \2")),
    ccx("stars", edit(DAT, ROW, rb"\n 5 ************* \2")),
    ccx("an exponent without E", edit(DAT, ROW, rb"\n 5 0.123456-100 \2"), make=fine),  # as Fortran writes it
    ccx("an exponent without E, too large", edit(DAT, ROW, rb"\n 5 0.123456+100 \2")),
    ccx("nodal forces without balance", edit(DAT, rb"(forces [^\n]*ALL.*?)" + ROW, rb"\1\n 5 \2 7.000000E+00"), "balance"),
    ccx("a displacement of 1e300", edit(DAT, ROW, rb"\n 5 1.000000E+300 \2")),
    ccx("a number missing", edit(DAT, ROW, rb"\n 5 \2")),
    ccx("a row missing", edit(DAT, ROW + rb"[^\n]*", b"")),
    ccx("a row twice", edit(DAT, rb"(" + ROW + rb"[^\n]*)", rb"\1\1")),
    ccx("a label that is not there", edit(DAT, ROW, rb"\n 99999 \1 \2")),
    ccx("a label of 0", edit(DAT, ROW, rb"\n 0 \1 \2")),
    ccx("a label that is no whole number", edit(DAT, ROW, rb"\n 5.5 \1 \2")),
    ccx("another node's label", edit(DAT, ROW, rb"\n 6 \1 \2")),
    ccx("text in the table", edit(DAT, ROW, rb"\n 5 error \2")),
    ccx("cut in the last table", recoded(DAT, lambda data: data[:-200])),
    ccx("cut in a number", recoded(DAT, lambda data: data[:-3])),
    ccx("the last step missing", recoded(DAT, lambda data: data[: data.index(b"2.0000000E+00") - 60])),
    ccx("the first step missing", recoded(DAT, lambda data: data[data.index(b"2.0000000E+00") - 60 :])),
    ccx("no forces", recoded(DAT, lambda data: data.replace(b"forces (", b"force: ("))),
    ccx("forces of another set", recoded(DAT, lambda data: data.replace(b"set TOP", b"set BOTTOM"))),
    ccx("times of another deck", recoded(DAT, lambda data: data.replace(b"time  1.0", b"time  1.5"))),
    ccx("empty results", holds(DAT, "")),
    ccx("no results", lambda place: (place / DAT).unlink()),
    ccx("bytes for results", holds(DAT, bytes(range(256)) * 10)),
    ccx("an error in its output", all_of(holds(SAID, "*ERROR reading *MATERIAL: no name\n"), holds(DAT, "")), "no name"),
    ccx("a keyword left out", holds(SAID, "*WARNING reading *STEP: parameter not recognized:\n FOO=1\n"), "FOO"),
    ccx("crashes", program("ccx", "kill -SEGV $$\n")),
    ccx("exit code 3 and nothing else", program("ccx", "exit 3\n")),
    ccx("ends after a part of the results", program("ccx", "head -c 300 {0}/ready.dat > deck.dat\nkill -9 $$\n")),
    ccx("good results and exit code 1", program("ccx", "cp {0}/ready.dat deck.dat\nexit 1\n")),
    ccx("prints without end", program("ccx", "yes | head -c 50000000\nexit 1\n")),
    ccx("results without end", program("ccx", "head -c 100000000 /dev/zero > deck.dat\n")),
    ccx("results from /dev/zero", program("ccx", "ln -s /dev/zero deck.dat\n"), "deck.dat", "a device"),
    ccx("results in a pipe", program("ccx", "mkfifo deck.dat\n"), "deck.dat", "a pipe"),
    ccx("results in a folder", program("ccx", "mkdir deck.dat\n"), "deck.dat", "a folder"),
    ccx("results in a link to nothing", program("ccx", "ln -s none deck.dat\n"), "deck.dat"),
    ccx("its output in a pipe", program("ccx", "rm output.log\nmkfifo output.log\n"), "output.log", "a pipe"),
    ccx("removes its folder", program("ccx", 'rm -rf "$PWD"\n'), "calculix", "output.log"),
    ccx("no version", lambda place: (place / "ccx").write_text("#!/bin/sh\necho hello\n"), "calculix", "hello"),
    ccx("another version", lambda place: (place / "ccx").write_text('#!/bin/sh\necho "Version 9.9"\n'), "calculix.json"),
    ccx("not executable", lambda place: (place / "ccx").chmod(0o644), "ccx"),
    ccx("no program", lambda place: (place / "ccx").unlink(), "ccx"),
    ccx("a folder for a program", lambda place: ((place / "ccx").unlink(), (place / "ccx").mkdir()), "ccx"),
    ccx("text for a program", lambda place: (place / "ccx").write_text("hello\n"), "ccx"),
    ccx("an interpreter that is not there", lambda place: (place / "ccx").write_text("#!/no/such/shell\n"), "ccx"),
    abaqus("NaN in a displacement", recoded(FIL, lambda data: data.replace(b"D 0.0", b"D  NaN", 1) if b"D 0.0" in data else re.sub(rb"D( *)-?\d\.\d{15}D[+-]\d\d", rb"D                NaN   ", data[2000:], count=1))),
    abaqus("stars", recoded(FIL, lambda data: data[:3000] + b"*" * 22 + data[3022:])),
    abaqus("cut in a record", recoded(FIL, lambda data: data[:-500])),
    abaqus("the last step missing", recoded(FIL, lambda data: data[: len(data) * 6 // 10])),
    abaqus("empty results", holds(FIL, "")),
    abaqus("no results", lambda place: (place / FIL).unlink()),
    abaqus("bytes for results", holds(FIL, bytes(range(256)) * 10)),
    abaqus("text for results", holds(FIL, "hello\n")),
    abaqus("digits flipped", recoded(FIL, lambda data: data[:1000] + data[1000:1400].translate(bytes.maketrans(b"0123", b"AXQZ")) + data[1400:])),
    abaqus("an error in its output", all_of(holds(SAID, "***ERROR: NO MATERIAL\n"), holds(FIL, "")), "NO MATERIAL"),
    abaqus("no licence", all_of(holds(SAID, "Error: no license for abaqus is free\n"), holds(FIL, "")), "license"),
    abaqus("crashes", program("abaqus", "kill -SEGV $$\n")),
    abaqus("results from /dev/zero", program("abaqus", "ln -s /dev/zero deck.fil\n"), "deck.fil", "a device"),
    abaqus("results in a pipe", program("abaqus", "mkfifo deck.fil\n"), "deck.fil", "a pipe"),
    abaqus("results in a folder", program("abaqus", "mkdir deck.fil\n"), "deck.fil", "a folder"),
    abaqus("messages in a pipe", program("abaqus", "mkfifo deck.msg\n"), "deck.msg", "a pipe"),
    abaqus("removes its folder", program("abaqus", 'rm -rf "$PWD"\n'), "abaqus", "output.log"),
    abaqus("no release", lambda place: (place / "abaqus").write_text("#!/bin/sh\necho hello\n"), "abaqus", "hello"),
    abaqus("no program", lambda place: (place / "abaqus").unlink()),
    abaqus("a command with an unknown name", nothing, environment={"FINGERFIT_ABAQUS": "./abaqus {jbo}"}),
    abaqus("a command with an open quote", nothing, environment={"FINGERFIT_ABAQUS": "./abaqus 'job"}),
    abaqus("an empty command", nothing, environment={"FINGERFIT_ABAQUS": " "}),
]  # fmt: skip
