"""A run that is told to end (SIGTERM) ends, whatever Snakemake's scheduler is doing; one that is done ends at once."""

from __future__ import annotations

import _thread
import gc
import threading
from functools import wraps
from importlib import import_module
from typing import Any


def end_when_told() -> None:
    """Let Snakemake handle SIGTERM in a thread of its own.

    Its handler takes a lock that the scheduler holds, in the same thread, while it looks for the next jobs: then both
    wait for ever (Snakemake 9, job_scheduler.py). In a search, where each round asks for the next one, that is often:
    one of eight runs hung. Other versions, where it is elsewhere, are left as they are.
    """
    try:
        scheduler = import_module("snakemake.scheduling.job_scheduler").JobScheduler
        ended = scheduler.exit_gracefully
    except (ImportError, AttributeError):
        return
    if hasattr(ended, "__wrapped__"):
        return

    @wraps(ended)
    def beside(self: Any, *arguments: Any) -> None:
        # no Thread: it takes locks itself, which whoever was interrupted may hold
        _thread.start_new_thread(ended, (self, *arguments))

    scheduler.exit_gracefully = beside


def end_at_once() -> None:
    """When no job is left: cancel the timers of Snakemake's scheduler, and leave its objects as they are.

    After each choice of jobs a timer is set that looks for more of them a second later; Python would wait for it. It
    would look through all objects for those that nobody needs, which takes another third of a second.
    """
    for thread in threading.enumerate():
        if isinstance(thread, threading.Timer):
            thread.cancel()
    gc.freeze()
