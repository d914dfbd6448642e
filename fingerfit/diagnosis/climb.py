"""From model to model: `discover` fits, diagnoses and changes config.yaml until the model is adequate."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from fingerfit.core.errors import FingerfitError
from fingerfit.core.files import keep_json, read_record, read_text, write_text
from fingerfit.diagnosis.ladder import add, drop, refine, run_again
from fingerfit.model.effect import MESH_ERROR, OUTLINE, Effect
from fingerfit.provenance.call import command
from fingerfit.provenance.results import model_folder, study_folder
from fingerfit.settings.bound import effects_of
from fingerfit.settings.config import Settings, load_settings
from fingerfit.settings.finer import MESHES

RUNGS = 8
"""Most models that `discover` fits in one call."""
TRIED = "tried.json"
"""What `discover` is trying, in the folder of the study: a call that was killed goes on there."""


@dataclass
class Tried:
    """What `discover` has changed in a config to see whether it does.

    Parameters
    ----------
    adequate : str
        The config of the last adequate model; empty where there was none.
    dropped : str
        The effect that was dropped from it.
    coarser : str
        The config before the mesh was made finer.
    meshes : int
        How often it was.
    """

    adequate: str = ""
    dropped: str = ""
    coarser: str = ""
    meshes: int = 0

    @staticmethod
    def read(path: Path, config: Path) -> Tried:
        """What an earlier call was trying when it ended; nothing where the config is another one since."""
        if not path.exists():
            return Tried()
        found = read_record(path, "config", *asdict(Tried()))
        return Tried(**found) if found.pop("config") == read_text(config) else Tried()

    def keep(self, path: Path, config: Path) -> None:
        """Write it, with the config that it belongs to."""
        keep_json(path, {**asdict(self), "config": read_text(config)})


def discover(config: Path, cores: int, say: Callable[[str], None]) -> None:
    """Fit, diagnose, add the missing effect, until the model is adequate or no known effect explains the rest.

    Of effects that these data cannot tell apart the one that fits best is added, and `say` is told so. An effect that
    an adequate model may not need is dropped; where the model is not adequate without it, it comes back, and that is
    all. So is one of no known form beside an effect that was added later, by which known effects may be seen: these
    are then added in its place. Where the mesh is too coarse, a finer one is taken; one that has no fit is given up.
    A call that was killed goes on with what it tried, unless the config was changed since.

    Raises
    ------
    FingerfitError
        When the workflow fails.
    """
    path = study_folder(load_settings(config)) / TRIED
    tried = Tried.read(path, config)
    for _ in range(RUNGS):
        done = _next(config, cores, tried, say)
        if not done:
            return path.unlink(missing_ok=True)
        tried.keep(path, config)
    return say(f"stopped after {RUNGS} models; {done}, but not fitted anew: {run_again(config)}")


def _next(config: Path, cores: int, tried: Tried, say: Callable[[str], None]) -> str:
    """Fit and diagnose the model of a config, and change that; what was done to it, nothing at the end."""
    if subprocess.run(command(["diagnose"], config, cores), check=False).returncode:
        if not tried.coarser:
            raise FingerfitError(f"{config}: the workflow failed; its messages are above")
        # at glued corners a finer mesh may have no equilibrium
        say("the fit on the finer mesh failed, for the reason above: the coarser mesh is taken back")
        write_text(config, tried.coarser)
        tried.coarser, tried.meshes = "", MESHES
        return "the last mesh is taken back"
    tried.coarser, settings = "", load_settings(config)
    say(_told(read_record(model_folder(settings) / "rung.json", "model", "error", "simulations", "sentence")))
    diagnosis = read_record(model_folder(settings) / "diagnosis.json", "effects", "verdict")
    known, dropped = effects_of(Path(settings.study)), tried.dropped
    instead = bool(dropped) and known[dropped].probe and _names_known(diagnosis, known)
    if dropped and diagnosis["verdict"] != "adequate" and not instead:
        say(f"without {dropped} the model is not adequate: {dropped} is taken back")
        write_text(config, tried.adequate)
        tried.dropped = ""
        return "the last effect is taken back"
    spare = [*diagnosis.get("spare", ()), *_without_form(settings, known)]
    if spare and not diagnosis["effects"] and (dropped or not tried.adequate):
        tried.adequate, tried.dropped = read_text(config), spare[0]
        why = "has no known form, which may show" if known[spare[0]].probe else "may not be needed"
        say(f"{spare[0]} {why} beside the others: dropping it")
        say(drop(config, spare[0]))
        return "the last effect is dropped"
    if tried.meshes < MESHES and _is_too_coarse(known, diagnosis):
        before = read_text(config)
        try:
            say(refine(config))
        except FingerfitError as error:
            say(f"the mesh stays as it is: {error}")
        else:
            tried.coarser, tried.meshes = before, tried.meshes + 1
            return "the last mesh is finer"
    if not diagnosis["effects"]:
        results = study_folder(settings)
        say(f"ladder: {results}/ladder.json; page: {results}/report.html")
        return ""
    first, *others = diagnosis["effects"]
    if others:
        say(f"these data cannot tell {first} from {' and '.join(others)}: adding {first}, which fits best")
    say(add(config, first))
    if OUTLINE in settings.model.effects and known[first].moves_first:
        say(f"{first} says where the first picture shows the sides: {OUTLINE}, by which they lie there, is dropped")
        say(drop(config, OUTLINE))
    return "the last effect is added"


def _without_form(settings: Settings, known: Mapping[str, Effect]) -> list[str]:
    """Effects of no known form in a model, beside others that were added later."""
    return [name for name in list(settings.model.effects)[:-1] if known[name].probe]


def _names_known(diagnosis: Mapping[str, Any], known: Mapping[str, Effect]) -> bool:
    """Whether a diagnosis names an effect first that has a form."""
    return bool(diagnosis["effects"]) and not known[diagnosis["effects"][0]].probe


def _is_too_coarse(known: Mapping[str, Effect], diagnosis: Mapping[str, Any]) -> bool:
    """Whether a diagnosis blames the mesh of a model."""
    blamed = known.get(diagnosis.get("numerics", ""))
    return blamed is not None and blamed.signal == MESH_ERROR


def _told(rung: dict[str, Any]) -> str:
    """One line on a rung: its errors, its simulations, the verdict, and the family of what that names."""
    fitted, held_out = rung["error"]["fitted"], rung["error"]["held_out"]
    held = "" if held_out is None else f", {held_out:.3g} on held-out steps"
    counted = rung["simulations"]
    ends = "".join(
        f"; {name} ends at its {entry['at_bound']} bound"
        for name, entry in (rung.get("parameters") or {}).items()
        if entry.get("at_bound")
    )
    family = f". {rung['family_sentence']}" if rung.get("family_sentence") else ""
    return (
        f"{rung['model']}: error {fitted:.3g} times the noise level{held}; {counted['run']} simulations run,"
        f" {counted['reused']} reused from models below; {rung['sentence']}{ends}{family}"
    )
