"""A solver that fails in the middle of a search, and works again when the workflow is called again."""

import os
import shutil
import signal
import time

from workspace import MODEL, Fault

AREA = "solver in the middle"
# counts its calls, does what is said at one of them, and is CalculiX at all others
PROGRAM = """#!/bin/sh
if [ "$1" = -v ]; then exec {ccx} -v; fi
echo x >> "{counts}"
if [ -e "{faulty}" ] && [ "$(wc -l < "{counts}")" -ge 3 ]; then
{does}
fi
exec {ccx} "$@"
"""
WAYS = {
    "crashes": "kill -SEGV $$",
    "is killed": "kill -KILL $$",
    "ends with code 3": "exit 3",
    "says an error": 'echo "*ERROR in e_c3d: nonpositive jacobian"; exit 1',
    "writes NaN": '{ccx} "$@"; sed -i "s/ [-0-9.]*E-0[0-9]/ NaN/" deck.dat; exit 0',
    "writes stars": '{ccx} "$@"; sed -i "s/E-01/*****/g" deck.dat; exit 0',
    "cuts its table": '{ccx} "$@"; head -c 500 deck.dat > d; mv d deck.dat; exit 0',
    "writes nothing": "exit 0",
    "writes another deck's results": '{ccx} "$@"; sed -i "s/time  0.2000000E+01/time  0.9000000E+01/" deck.dat; exit 0',
    "is gone": None,
}


def without_ccx():
    return "" if shutil.which("ccx") else "CalculiX (ccx) is not installed"


def prepared(place, does):
    program = place / "solver"
    text = PROGRAM.replace("{does}", does or ":").replace("{ccx}", shutil.which("ccx") or "ccx")
    program.write_text(text.replace("{counts}", str(place / "counts")).replace("{faulty}", str(place / "faulty")))
    program.chmod(0o755)
    place.environment["FINGERFIT_CCX"] = str(program)
    place.configure(solver="calculix")


def fails(does):
    def happens(place):
        prepared(place, does)
        (place / "faulty").write_text("")
        if does is None:
            running = place.start()
            running.until(place / f"{MODEL}/rounds/1.json")
            (place / "solver").rename(place / "gone")
            code, said = running.end()
            (place / "gone").rename(place / "solver")
        else:
            code, said = place.run()
        (place / "faulty").unlink()
        assert code != 0, "what the solver did was not noticed"
        return said

    return happens


def hangs(place):
    """Someone ends the solver that hangs."""
    prepared(place, 'echo $$ > "$FINGERFIT_CCX.pid"; exec sleep 1000')
    (place / "faulty").write_text("")
    running = place.start()
    running.until(place / "solver.pid")
    time.sleep(0.5)
    os.killpg(running.process.pid, signal.SIGINT)  # as Ctrl-C does
    running.end()
    (place / "faulty").unlink()


SAYS = ("(simulate|propose|prepare): .*(calculix|ccx|solver)", "log: ")
FAULTS = [
    *(Fault(name, fails(does), "study", says=SAYS, other=True, needs=without_ccx) for name, does in WAYS.items()),
    Fault("hangs, and the run is ended", hangs, "study", other=True, needs=without_ccx),
]
