"""How a run ends: SIGTERM while Snakemake's scheduler holds the lock that its handler takes, and its timers."""

import os
import signal
import threading
import time

from snakemake.scheduling.job_scheduler import JobScheduler

from fingerfit.provenance.ending import end_at_once, end_when_told


class Scheduler(JobScheduler):
    """No more of a scheduler than what its handler needs."""

    def __init__(self):
        self._lock, self._open_jobs, self._user_kill = threading.Lock(), threading.Semaphore(0), None


def test_a_signal_while_the_scheduler_holds_its_lock(monkeypatch):
    monkeypatch.setattr(JobScheduler, "exit_gracefully", JobScheduler.exit_gracefully)
    end_when_told()
    end_when_told()  # as by a Snakefile that is a module of another one
    scheduler = Scheduler()
    before = signal.signal(signal.SIGTERM, scheduler.exit_gracefully)
    try:
        with scheduler._lock:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.1)
            assert scheduler._user_kill is None
        # Snakemake's own handler would wait for ever above
        assert scheduler._open_jobs.acquire(timeout=60)
        assert scheduler._user_kill == "graceful"
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_timer_of_the_scheduler_is_not_waited_for():
    timer = threading.Timer(3600, lambda: None)
    timer.start()
    end_at_once()
    timer.join(60)
    assert not timer.is_alive()
