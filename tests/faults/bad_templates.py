"""Templates of decks: names, syntax, what is included, and what never ends."""

import os

from battery import all_of, bad, fine, holds, put, swap
from places import TEMPLATE

AREA = "templates"
FILE = "study/own.inp.j2"
USED = put("config.yaml", "model.template", "own.inp.j2")


def text(name, content, *says, **more):
    """Another template."""
    return more.pop("make", bad)(name, all_of(holds(FILE, content), USED), *(says or ["own.inp.j2"]), **more)


def line(name, content, *says, **more):
    """A line in the template that is fine."""
    return text(name, TEMPLATE.replace("** --- base", f"{content}\n** --- base"), *says, **more)


CASES = [
    text("the template itself", TEMPLATE, make=fine),
    text("empty", ""),
    text("nothing of a deck", "hello\n"),
    text("no steps", TEMPLATE.partition("** --- one step")[0]),
    text("no mesh", TEMPLATE.replace("*INCLUDE, INPUT={{ mesh }}\n", "")),
    text("cut in a loop", TEMPLATE[:-20]),
    text("a step that does not end", TEMPLATE.replace("*END STEP\n", ""), "own.inp.j2"),
    text("bytes", bytes(range(256)) * 8),
    text("not UTF-8", TEMPLATE.encode() + "** größe\n".encode("latin-1")),
    text("UTF-16", TEMPLATE.encode("utf-16")),
    text("a byte order mark", b"\xef\xbb\xbf" + TEMPLATE.encode(), make=fine),
    text("CRLF", TEMPLATE.replace("\n", "\r\n"), make=fine),
    line("a misspelt name", "{{ layers[0].mue }}"),
    line("an unknown name", "{{ stiffness }}"),
    line("an unknown filter", "{{ 3 | nubmer }}"),
    line("a filter of a text", "{{ 'x' | number }}"),
    line("an unknown test", "{% if dim is plane %}{% endif %}"),
    line("an unknown tag", "{% mesh %}"),
    line("a loop without names", "{% for %}"),
    line("a loop that is not closed", "{% for layer in layers %}"),
    line("an end without beginning", "{% endfor %}"),
    line("an open brace", "{{ layers"),
    line("a layer that is not there", "{{ layers[9].mu }}"),
    line("a division by zero", "{{ 1 / 0 }}"),
    line("a text and a number", "{{ 'a' + 1 }}"),
    line("the sandbox: classes", "{{ ''.__class__.__mro__[1].__subclasses__() }}"),
    line("the sandbox: globals", "{{ cycler.__init__.__globals__ }}"),
    line("the sandbox: import", "{% import 'os' as os %}"),
    line("the sandbox: a call", "{{ open('/etc/passwd') }}"),
    line("a missing part", "{% include 'nothing.j2' %}", "nothing.j2"),
    line("a part outside", "{% include '../config.yaml' %}", "config.yaml"),
    line("a part by its full path", "{% include '/etc/passwd' %}", "passwd"),
    line("a part that is a folder", "{% include 'material' %}", "material"),
    line("a part that is bytes", "{% include 'before.mha' %}", "before.mha|own.inp.j2"),
    line("an unknown keyword", "*HYPERFOAM", "HYPERFOAM"),
    line("a keyword without its parameter", "*MATERIAL", "MATERIAL"),
    line("data that is no number", "*BOUNDARY\nTOP, x, y", "BOUNDARY"),
    line("a set that is not there", "*BOUNDARY\nNOWHERE, 1, 2", "NOWHERE"),
    line("an include of the deck that is not there", "*INCLUDE, INPUT=none.inp", "none.inp"),
    line("an include of the deck outside", "*INCLUDE, INPUT=/etc/passwd", "passwd"),
    line("an element of its own that is bad", "*ELEMENT, TYPE=CPE4\n99, 1, 2, 3", "ELEMENT"),
    line("a comment", "** nothing", make=fine),
    line("a part in itself", "{% include 'own.inp.j2' %}"),
    line("a macro in itself", "{% macro m() %}{{ m() }}{% endmacro %}{{ m() }}"),
    line("a loop of 10^9", "{% for i in range(1000000000) %}{% endfor %}"),
    line("loops in loops", "{% for i in range(99999) %}{% for j in range(99999) %}{% endfor %}{% endfor %}"),
    line("a power", "{{ 9**9**9 }}"),  # in Jinja that of 9**9: a number of 78 digits
    line("a power of a power", "{{ 9**(9**9) }}"),
    line("a text of 10 GB", "{{ 'x' * 10**10 }}"),
    line("a format of 10 GB", "{{ '%10000000000d' % 1 }}"),
    line("a deck of 100 MB", "{% for i in range(99999) %}** {{ 'x' * 1000 }}\n{% endfor %}"),
    line("brackets", "{{ " + "(" * 2000 + "1" + ")" * 2000 + " }}"),
    bad("no such template", put("config.yaml", "model.template", "none.inp.j2"), "none.inp.j2"),
    bad("a template outside", put("config.yaml", "model.template", "../../config.yaml"), "config.yaml"),
    bad("a folder", all_of(lambda place: (place / FILE).unlink(), lambda place: (place / FILE).mkdir(), USED), "own.inp.j2"),
    bad("a pipe", all_of(lambda place: (place / FILE).unlink(), lambda place: os.mkfifo(place / FILE), USED), "own.inp.j2"),
    bad("/dev/zero", all_of(lambda place: (place / FILE).unlink(), lambda place: (place / FILE).symlink_to("/dev/zero"), USED), "own.inp.j2"),
    bad("a boundary that has no part", swap("study/study.yaml", "held", "hangs"), "boundary.base"),
]  # fmt: skip
