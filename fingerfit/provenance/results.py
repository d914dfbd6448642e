"""Where results go: a folder for each study and model, which nothing else may claim, and what in it is damaged."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import IO, Any

from fingerfit.core.contents import Contents
from fingerfit.core.errors import FingerfitError, InputError, StateError
from fingerfit.core.files import keep_json, read_json, write_json
from fingerfit.core.folders import OURS, PACKAGE, template_folders
from fingerfit.core.plain import to_plain
from fingerfit.fit.rounds import included_files, is_named
from fingerfit.settings.choices import KNOWN, read_checked
from fingerfit.settings.config import CONFIG, PLAIN, Settings
from fingerfit.solvers.registry import get_solver

MARK = ".fingerfit.json"
"""What is known of the contents of files; it also tells that a folder is one of results."""
LOG = "discover.log"
"""What `snakemake discover` says, in the folder of the study."""
OWNER = "study.json"
LOCK = ".lock"
"""Locked by the run that works on the results of a model."""
SHARED = ("sims", "meshes")
"""Folders beside those of the models."""
BELOW = ("simulations.json", "residual.npz")
"""What a diagnosis reads of the models below."""
DIAGNOSED = ("compare.npz", "diagnosis.npz", "diagnosis.json", "rung.json", *BELOW)
KEPT = (
    "settings.json", "prepared*.npz", "mesh*.inp", "refined*.inp", "rounds/*.json", "estimate.json", "figures/*.png",
    *DIAGNOSED,
)  # fmt: skip
"""Results of a model that can be told from damaged ones."""
FITTED = ("rounds/*.json", "estimate.json", "table.txt", "figures/*.png", *DIAGNOSED)
"""Results that the effects of a study go into, which the search and the diagnosis know."""


def study_folder(settings: Settings) -> Path:
    """``results/{study}``: the study's path in the workspace, without ``studies/``; of one outside of it, its name."""
    path = Path(os.path.relpath(settings.study))
    if ".." in path.parts:
        path = Path(path.resolve().name)
    elif path.parts[:1] == ("studies",) and len(path.parts) > 1:
        path = path.relative_to("studies")
    return Path(settings.results) / path


def model_folder(settings: Settings) -> Path:
    """``results/{study}/{model}``."""
    return study_folder(settings) / settings.model.full_name


def refuse(settings: Settings, where: Path | str = CONFIG) -> None:
    """Refuse folders of results that are, hold or lie in something else; `where` is named in errors.

    Raises
    ------
    InputError
        For a folder of the study, of templates or of fingerfit, one outside of the workspace with other things in it,
        one that belongs to another study, or whose name no rule can have, and a name of a model that something else
        has.
    """
    results, study, model = Path(settings.results), Path(settings.study), settings.model.name
    if not study.is_dir():
        raise InputError(where, "study", settings.study, "the folder of a study")
    if not re.fullmatch(PLAIN, str(study_folder(settings))):  # the name of a folder that config.yaml does not have
        found = f"{settings.study}, a folder named {study_folder(settings).name!r}"
        raise InputError(where, "study", found, "a folder named with letters, digits and . _ + - only, no spaces")
    place = results.resolve()
    others = {"the study": study, "fingerfit": PACKAGE, "templates": OURS}
    packages = [("an installed package", folder) for folder in template_folders()[1:]]
    for name, folder in [*others.items(), *packages]:
        other = folder.resolve()
        if place == other or place in other.parents or other in place.parents:
            relation = "is" if place == other else "holds" if place in other.parents else "lies in"
            expected = f"a folder of its own, as {os.path.relpath(study.resolve().parent / 'results')}"
            raise InputError(where, "results", f"{results}, which {relation} the folder of {name}", expected)
    if results.exists() and not results.is_dir():
        raise InputError(where, "results", f"{results}, which is a file", "a folder")
    if Path.cwd().resolve() not in place.parents and results.exists() and not (results / MARK).exists():
        # the log of `snakemake discover` is there before the first model begins
        entry = next((path for path in results.rglob("*") if not path.is_dir() and path.name != LOG), None)
        if entry is not None:
            found = f"{results}, outside of this workspace, with {entry.relative_to(results).parts[0]} in it"
            raise InputError(where, "results", found, "a folder in the workspace, an empty one or one of results")
    if model in SHARED:
        raise InputError(where, "model.name", model, f"another name: {' and '.join(SHARED)} are folders of all models")
    _refuse_other_study(settings, where)


def _refuse_other_study(settings: Settings, where: Path | str) -> None:
    results, folder, mine = settings.results, study_folder(settings), _identity(settings)
    above = [path for path in folder.parents if Path(results) in path.parents]
    below = [path.parent for depth in ("*", "*/*") for path in sorted(folder.glob(f"{depth}/{OWNER}"))]
    for place in [folder, *above, *below]:
        owner = read_json(place / OWNER)["study"] if (place / OWNER).exists() else None
        if owner is not None and (place != folder or owner != mine):
            other = os.path.relpath(Path(results).resolve() / owner)
            expected = f"another folder, as {results}-{Path(settings.study).resolve().parent.name}"
            raise InputError(where, "results", f"{settings.study}, but {place} has results of {other}", expected)


def _identity(settings: Settings) -> str:
    """The study seen from the results, so that both can be copied to another place."""
    return os.path.relpath(Path(settings.study).resolve(), Path(settings.results).resolve())


def claim(settings: Settings) -> None:
    """Make the folder of a study's results its own."""
    mark = Path(settings.results) / MARK
    if not mark.exists():
        write_json(mark, {})
    file = study_folder(settings) / OWNER
    if not file.exists():
        keep_json(file, {"study": _identity(settings)})


def hold(settings: Settings) -> IO[str]:
    """Keep other runs off the results of a model while what is returned is open: at most to the end of the process.

    Snakemake locks a folder by files that it looks for first and writes then: two runs that start together do not see
    each other's.

    Raises
    ------
    StateError
        When another run works on them.
    """
    path = model_folder(settings) / LOCK
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = path.open("w", encoding="utf-8")
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:  # of a file system without locks: go on
        if isinstance(error, BlockingIOError):
            raise StateError(f"{path.parent}: another run is working here: wait for its end") from error
    return handle


def mend(settings: Settings, contents: Contents, remove: bool) -> list[str]:
    """Remove what is damaged of the results of a model, so that it is made again; a line for each.

    So are rounds that asked another solver than the one that is here, settings that another version wrote, and what was
    made with other effects than the study knows now.
    Snakemake would know it by the code that made them, but only in the folder where it made them.

    Parameters
    ----------
    settings : Settings
    contents : Contents
        Files that have not changed since they were looked at are not read again.
    remove : bool
        Whether to remove it, or only to say so.

    Raises
    ------
    StateError
        For what cannot be removed.
    """
    lines, done = [], "removed" if remove else "it will be removed"
    others = list(_asked_of_others(settings, contents))
    for path in others if remove else ():
        path.unlink(missing_ok=True)
    if others:
        lines.append(f"{others[0].parent}: asked another solver or version; {done} and made again")
    written = model_folder(settings) / "settings.json"
    if contents.intact(written) and not _is_of_here(settings, written):
        if remove:
            written.unlink(missing_ok=True)
        lines.append(f"{written}: of another version; {done} and made again")
    elif contents.intact(written) and _of_other_effects(settings, written):
        made = [path for name in ("settings.json", *FITTED) for path in model_folder(settings).glob(name)]
        for path in made if remove else ():
            path.unlink(missing_ok=True)
        lines.append(
            f"{written}: knows other effects than there are now; it and what follows from it: {done} and made again"
        )
    for path, *beside in _damaged(settings, contents):
        try:
            # of a link into Snakemake's cache, what it leads to as well
            for one in (path, path.resolve(), *beside) if remove else ():
                one.unlink(missing_ok=True)
        except OSError as error:
            raise StateError(
                f"{path}: is damaged and cannot be removed ({error.strerror}): rm {path.resolve()}"
            ) from error
        lines.append(f"{path}: is damaged; {done} and made again")
    return lines


def in_order(settings: Settings) -> None:
    """Give results that are older than what they are made from the times of these.

    So times, which a copy does not keep, make nothing run again: contents do
    (`fingerfit.provenance.stages.made_from`). Snakemake has no switch for that; and of what it calls ancient it does
    not notice that it is made anew in the same run.
    """
    study, model = study_folder(settings), model_folder(settings)
    rounds = sorted(model.glob("rounds/*.json"), key=lambda path: (len(path.name), path.name))
    below = [study / name for name in settings.model.path[-2:-1]]
    order = [[folder / "estimate.json"] for folder in below]  # the search starts there
    prepared = ("prepared*.npz", "mesh*.inp", "refined*.inp")
    order += [[model / "settings.json"], [path for name in prepared for path in sorted(model.glob(name))]]
    order += [[path] for path in rounds]
    order.append([model / "estimate.json", model / "table.txt", *model.glob("figures/*")])
    order += [[folder / name for name in BELOW] for folder in below]
    order.append([path for name in DIAGNOSED for path in sorted(model.glob(name))])
    # of a folder Snakemake has the time in a file
    order.append([study / "ladder.json", study / "report.html", model / "export/.snakemake_timestamp"])
    latest = 0
    for group in order:
        there = [path for path in group if path.exists()]
        for path in there:
            if path.stat().st_mtime_ns < latest:
                with contextlib.suppress(OSError):  # of somebody else: made again
                    os.utime(path, ns=(latest, latest))
        latest = max([latest, *(path.stat().st_mtime_ns for path in there)])


def _damaged(settings: Settings, contents: Contents) -> Iterator[tuple[Path, ...]]:
    """What is damaged, each with what must be made again with it."""
    study, model = study_folder(settings), model_folder(settings)
    files = [path for pattern in KEPT for path in sorted(model.glob(pattern))]
    files += [
        path
        for pattern in ("ladder.json", "report.html", "sims/*/solution.npz")
        for path in sorted(study.glob(pattern))
    ]
    yield from ((path,) for path in files if not contents.intact(path))
    for path in sorted(model.glob("rounds/*.json")):
        whole = contents.intact(path)
        if whole and not contents.remember(f"number {path}", contents.of([path]), partial(_is_numbered, path)):
            yield (path,)  # another round's copy
    table, estimate = model / "table.txt", model / "estimate.json"
    both = table.exists() and estimate.exists() and contents.intact(estimate)
    if both and not contents.remember(
        f"table {table}", contents.of([table, estimate]), partial(_tells, table, estimate)
    ):
        yield (table,)
    for mesh in sorted((study / "meshes").glob("*.inp")):
        if contents.digest(mesh) != mesh.stem:
            yield (mesh,)
    for deck in sorted((study / "sims").glob("*/deck.inp")):
        solver = deck.with_name("solver.json")
        if not contents.remember(f"deck {deck}", contents.of([deck, solver]), partial(_is_named, deck, solver)):
            # the name is that of both; of slopes beside it, whoever solves them reads its deck
            yield deck, solver, deck.with_name("solution.npz")


def _asked_of_others(settings: Settings, contents: Contents) -> Iterator[Path]:
    """Rounds whose simulations nobody here can run."""
    try:
        here = get_solver(settings.solver).identity()
    except FingerfitError:
        return  # check says so
    for path in sorted(model_folder(settings).glob("rounds/*.json")):
        if contents.intact(path):
            asked = contents.remember(f"solver {path}", contents.of([path]), partial(_solver_of, path))
            if asked != here:
                yield path


def _solver_of(path: Path) -> Any:
    return read_json(path).get("solver")


def _is_of_here(settings: Settings, written: Path) -> bool:
    """Whether settings have the keys that this version reads; so does a file that is not there."""
    if not written.exists():
        return True
    try:
        read_checked(written)
    except StateError:
        return False
    found, wanted = read_json(written), settings.model_dump(mode="json")
    return all(found[part].keys() == wanted[part].keys() for part in ("model", "fit"))


def _of_other_effects(settings: Settings, written: Path) -> bool:
    """Whether settings were written with other effects than are known now; where it says which."""
    if not written.exists() or KNOWN not in (found := read_json(written)):
        return False
    return bool(found[KNOWN]["effects"] != json.loads(json.dumps(to_plain(settings.known_effects()))))


def _is_numbered(path: Path) -> bool:
    """Whether a round is the one that its file is named after."""
    return str(read_json(path).get("number")) == path.stem


def _tells(table: Path, estimate: Path) -> bool:
    """Whether a table is that of an estimate."""
    from fingerfit.fit.estimate import table_of

    return table.read_bytes() == table_of(read_json(estimate)).encode()


def _is_named(deck: Path, solver: Path) -> bool:
    try:
        text = deck.read_text(encoding="utf-8")
        return bool(included_files(text)) or is_named(deck, text, read_json(solver, kept=False))
    except (FingerfitError, OSError, ValueError, AttributeError):
        return False
