"""Disks that are full, folders that cannot be written, workspaces that move, clocks, two runs at once."""

import os
import resource
import shutil
import subprocess
import time

from workspace import MODEL, Fault, Workspace

AREA = "places and times"
FULL = ("cannot be written|No space left|File too large",)


def _mounts():
    """Why a small file system cannot be mounted here; empty where it can."""
    return "" if os.getuid() == 0 and shutil.which("mount") and _try_mount() else "mounting needs root"


def _try_mount():
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=64k", "none", folder], capture_output=True, check=False
        )
        if done.returncode == 0:
            subprocess.run(["umount", folder], check=True)
    return done.returncode == 0


def limited(size):
    """No file larger than some bytes, as where a quota is used up."""

    def happens(place):
        def limit():
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

        code, said = place.run(limit=limit)
        assert code != 0
        return said

    return happens


def full(size):
    """Results on a file system that is too small, and then is not."""

    def happens(place):
        folder = place / "results"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", str(folder)], check=True)
        try:
            code, said = place.run()
            assert code != 0
            kept = place / "kept"
            shutil.copytree(folder, kept, symlinks=True)
        finally:
            subprocess.run(["umount", "-l", str(folder)], check=True)
        folder.rmdir()
        kept.rename(folder)
        return said

    return happens


def read_only(place):
    folder = place / "results"
    (folder / "study/base/estimate.json").unlink()
    kept = place / "kept"
    folder.rename(kept)
    folder.mkdir()
    subprocess.run(["mount", "--bind", str(kept), str(folder)], check=True)
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", str(folder)], check=True)
        code, said = place.run()
        assert code != 0
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
    folder.rmdir()
    kept.rename(folder)
    return said


def results_are_a_file(place):
    shutil.rmtree(place / "results")
    (place / "results").write_text("")
    code, said = place.run()
    assert code != 0
    (place / "results").unlink()
    return said


def moved(place):
    other = place.path.with_name("elsewhere")
    place.path.rename(other)
    place.path = other


def copied_without_times(place):
    other = place.path.with_name("copy")
    shutil.copytree(place.path, other, copy_function=shutil.copyfile)
    place.path = other


def only_results_copied(place):
    """To a colleague: inputs and results, without hidden folders."""
    other = place.path.with_name("colleague")
    shutil.copytree(place.path, other, ignore=shutil.ignore_patterns(".snakemake"))
    place.path = other


def aged(pattern, seconds):
    """Another time of files, whose content stays."""

    def happens(place):
        for path in place.path.glob(pattern):
            if path.is_file():
                at = time.time() + seconds
                os.utime(path, (at, at))

    return happens


def two_at_once(place):
    shutil.rmtree(place / "results")
    first, second = place.start(), place.start()
    ends = [first.end(), second.end()]
    said = [said for code, said in ends if code != 0]
    assert len(said) < 2, said
    return said[0] if said else None


def second_begins_later(place):
    shutil.rmtree(place / "results")
    first = place.start()
    first.until(place / f"{MODEL}/rounds/1.json")
    code, said = place.run()
    first.end()
    return said if code != 0 else None


def same_name(place):
    """Another study in a folder of the same name fits into the same results, and then the first again."""
    shutil.copytree(place / "study", place / "other/study")
    table = place / "other/study/steps.csv"
    rows = [line.split(",") for line in table.read_text(encoding="utf-8").splitlines()]
    rows = [rows[0], *([row[0], row[1], f"{float(row[2]) * 2:g}", *row[3:]] for row in rows[1:])]
    table.write_text("\n".join(map(",".join, rows)) + "\n")
    place.configure(study="other/study")
    code, said = place.run()
    wrong = code == 0 and place.estimate() == before_of(place)
    assert not wrong, "the estimate of the other study"
    place.configure()
    return said if code != 0 else None


def before_of(place: Workspace) -> str:
    return (
        (place / "study/reference.json").read_text(encoding="utf-8")
        if (place / "study/reference.json").exists()
        else ""
    )


DAY = 86400.0
FAULTS = [
    Fault("no file above 1 kB from the start", limited(1000), "study", says=FULL),
    Fault("no file above 16 kB: prepared.npz", limited(16_000), "study", says=FULL),
    Fault("no file above 3 kB: a round", limited(3_000), "study", says=FULL),
    Fault("a disk of 16 kB", full("16k"), "study", says=FULL, needs=_mounts),
    Fault("a disk of 80 kB", full("80k"), "study", says=FULL, needs=_mounts),
    Fault("a disk of 120 kB", full("120k"), "study", says=FULL, needs=_mounts),
    Fault("results that cannot be written", read_only, says=("Read-only|cannot be written|rite-protected",), needs=_mounts),
    Fault("results are a file", results_are_a_file, says=("results",)),
    Fault("moved", moved),
    Fault("copied without times", copied_without_times),
    Fault("copied without .snakemake", only_results_copied),
    Fault(".snakemake removed", lambda place: shutil.rmtree(place / ".snakemake")),
    Fault(".snakemake/metadata removed", lambda place: shutil.rmtree(place / ".snakemake/metadata")),
    Fault("all of the results in the future", aged("results/**/*", DAY)),
    Fault("all of the inputs in the future", aged("study/**/*", DAY)),
    Fault("all of the inputs a day older", aged("study/**/*", -DAY)),
    Fault("the estimate older than its rounds", aged(f"{MODEL}/estimate.json", -DAY)),
    Fault("a round newer than the next", aged(f"{MODEL}/rounds/0.json", 60)),
    Fault("config.yaml touched", aged("config.yaml", 0)),
    Fault("everything touched", aged("**/*", 0)),
    Fault("the folder of simulations deleted", lambda place: shutil.rmtree(place / "results/study/sims")),
    Fault("the folder of rounds deleted", lambda place: shutil.rmtree(place / f"{MODEL}/rounds")),
    Fault("the folder of meshes deleted", lambda place: shutil.rmtree(place / "results/study/meshes")),
    Fault("the folder of the model deleted", lambda place: shutil.rmtree(place / MODEL)),
    Fault("a round too many", lambda place: shutil.copy(place / f"{MODEL}/rounds/2.json", place / f"{MODEL}/rounds/3.json")),
    Fault("temporary files of a killed run", lambda place: (place / f"{MODEL}/.estimate.json.x1y2").write_text("{")),
    Fault("two runs at once", two_at_once),
    Fault("a second run in the middle of the first", second_begins_later),
    Fault("two studies of the same name", same_name, says=("results", "study")),
]  # fmt: skip
