"""A run that is ended at each stage, and called again."""

import os
import shutil
import signal
import sys
import time

from workspace import MODEL, Fault

AREA = "ended runs"
STAGES = {
    # what is there before, target, what is taken away, and the log that tells that the stage has begun
    "prepare": ("study", "all", (), f"{MODEL}/logs/prepare.log"),
    "propose": ("fitted", "all", (f"{MODEL}/rounds",), f"{MODEL}/logs/propose/1.log"),
    "simulate": ("fitted", "all", ("results/study/sims",), "results/study/sims/*/solver.log"),
    "estimate": ("fitted", "all", (f"{MODEL}/estimate.json",), f"{MODEL}/logs/estimate.log"),
    "plot": ("fitted", "all", (f"{MODEL}/figures",), f"{MODEL}/logs/plot.log"),
    "diagnose_model": ("diagnosed", "diagnose", (f"{MODEL}/diagnosis.json",), f"{MODEL}/logs/diagnose.log"),
    "ladder": ("diagnosed", "diagnose", ("results/study/ladder.json",), "results/study/ladder.log"),
    "discover": ("fitted", "discover", (), f"{MODEL}/logs/diagnose.log"),
}


def _kill(running):
    running.process.send_signal(signal.SIGKILL)
    time.sleep(0.1)  # what it began goes on for a moment
    running.kill_all()


def _end(number, group):
    def end(running):
        if group:
            os.killpg(running.process.pid, number)
        else:
            running.process.send_signal(number)
        running.end()

    return end


WAYS = {"SIGKILL": _kill, "SIGINT": _end(signal.SIGINT, True), "SIGTERM": _end(signal.SIGTERM, False)}


def ended(stage, way):
    start, target, removed, log = STAGES[stage]

    def happens(place):
        for path in removed:
            shutil.rmtree(place / path) if (place / path).is_dir() else (place / path).unlink()
        for path in place.path.glob(log):
            path.unlink()
        command = ()
        if stage == "discover":
            command = [sys.executable, "-m", "fingerfit", "discover", "--config", "config.yaml", "--cores", "2"]
        running = place.start(target, command=command)
        while not list(place.path.glob(log)):
            assert running.process.poll() is None, running.text()[-2000:]
            time.sleep(0.02)
        time.sleep(0.1 * len(stage) % 0.4)  # another moment for each
        WAYS[way](running)

    return Fault(f"{stage}: {way}", happens, start, (target,) if target != "discover" else ("diagnose",))


FAULTS = [ended(stage, way) for stage in STAGES for way in WAYS]
