# PYTHON_ARGCOMPLETE_OK
"""The command line: the only place that prints errors and exits."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import textwrap
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fingerfit import __version__, commands
from fingerfit.core.errors import FingerfitError


def _count(text: str) -> int:
    """A whole number from 1, for argparse."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"found {text}; expected a whole number above 0")
    return int(text)


Command = Callable[[str, str, str], argparse.ArgumentParser]
"""Adds a command to the command line: name, help and an example, to the parser of its arguments."""
DECK = "fingerfit deck show DECK"
RESULTS = "results/phantom/base"
"""In the examples of commands for the workflow."""
SIM = "results/phantom/sims/NAME"
FIT = f"{RESULTS}/settings.json --data {RESULTS}/prepared.npz --mesh {RESULTS}/mesh.inp --sims results/phantom/sims"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="fingerfit", description="Material constants from pictures and forces.")
    parser.add_argument("--version", action="version", version=f"fingerfit {__version__}")
    subs = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, text: str, example: str) -> argparse.ArgumentParser:
        sub = subs.add_parser(name, help=text, **_described(text, example))
        sub.set_defaults(run=getattr(commands, name))
        return sub

    _add_start(command)
    _add_studies(command)
    _add_models(command)
    _add_deck(subs.add_parser("deck", help="look at a deck", **_described("look at a deck", DECK)))
    text = "write the schemas of config.yaml and study.yaml, and the tables of the keys of all files that people write"
    sub = command("docs", text, "fingerfit docs .")
    sub.add_argument("folder", type=Path, help="folder of the project")
    _add_workflow(command)
    return parser


def _described(text: str, example: str) -> dict[str, Any]:
    """What `--help` of a command says above and below its arguments."""
    about = textwrap.fill(f"{text[0].upper()}{text[1:]}.", 100)
    return {
        "description": about,
        "epilog": f"example:\n  {example}",
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }


def _add_start(command: Command) -> None:
    """What a user calls first, and last."""
    text = "draft a study from pictures and a table of forces, or from files of other programs, or copy an example"
    sub = command("new", text, "fingerfit new mine --pictures scans --forces forces.csv")
    sub.add_argument("study", type=Path, help="folder of the study, which is made")
    sub.add_argument("--pictures", type=Path, metavar="FOLDER", help="one before compression and some during it")
    sub.add_argument("--forces", type=Path, metavar="CSV", help="a row for each step, at most 200, below a head")
    sub.add_argument(
        "--from",
        dest="sources",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="displacements, forces; or a data.yaml",
    )
    sub.add_argument("--scale", type=float, metavar="MM", help="size of a pixel, where --from has pixels")
    sub.add_argument("--rate", type=float, metavar="HZ", help="frames in a second, where --from has readings in time")
    sub.add_argument("--example", metavar="NAME", help="phantom, hidden-tilt or hidden-inclusion")

    text = "fit a study: what is done already is not done again"
    sub = command("run", text, "fingerfit run studies/phantom --diagnose")
    sub.add_argument("study", type=Path, nargs="?", help="folder of the study (the one that config.yaml names)")
    sub.add_argument("--config", type=Path, help="settings (config.yaml in the study's folder, or here)")
    sub.add_argument("--diagnose", action="store_true", help="then say which effect the model lacks, and write a page")
    sub.add_argument("--export", action="store_true", help="then write tables and fields for other programs")
    sub.add_argument("--cores", type=_count, help="processors (all)")
    sub.add_argument("--profile", default="default", help="slurm for a cluster, or the folder of a profile (default)")
    options = "[--config FILE] [--diagnose] [--export] [--cores N] [--profile NAME]"
    sub.usage = f"fingerfit run [STUDY] {options} [-- OPTIONS OF SNAKEMAKE]"

    sub = command("open", "show the page of a study in the browser", "fingerfit open studies/phantom")
    sub.add_argument("study", type=Path, nargs="?", help="folder of the study (the one that config.yaml names)")
    sub.add_argument("--config", type=Path, help="settings (config.yaml in the study's folder, or here)")

    command("doctor", "say what fits find on this machine, and let each solver solve something", "fingerfit doctor")


def _add_studies(command: Command) -> None:
    """What a user does before a fit: studies and meshes."""
    sub = command(
        "check",
        "say what was understood of a study, try its first simulation, and list every problem",
        "fingerfit check studies/phantom",
    )
    sub.add_argument("study", type=Path, help="folder of the study, or its study.yaml")
    sub.add_argument(
        "--config", type=Path, help="settings (config.yaml in the study's folder, or here where it names the study)"
    )
    sub.add_argument("--picture", type=Path, help="draw mesh, sets and points over the picture here (.png)")
    sub.add_argument("--no-solve", dest="solve", action="store_false", help="do not simulate the start of the search")

    sub = command(
        "experiment",
        "make a study by a virtual experiment",
        "fingerfit experiment studies/phantom/experiment.yaml --out studies/virtual",
    )
    sub.add_argument("description", type=Path, help="experiment.yaml")
    sub.add_argument("--out", type=Path, required=True, help="folder of the study")
    sub.add_argument("--force", action="store_true", help="replace a study that is there")

    sub = command(
        "finger",
        "mesh a finger, the reference one or another (docs/fingertip.md)",
        "fingerfit finger --out reference.inp",
    )
    sub.add_argument("--out", type=Path, required=True, help="the mesh (.inp)")
    sub.add_argument(
        "--anatomy", type=Path, metavar="YAML", help="numbers of the finger where they are not the reference's"
    )
    sub.add_argument("--size", type=float, default=3.0, help="of elements, relative to 35 000 tetrahedra (3)")
    sub.add_argument("--element", default="C3D10H", help="C3D4, C3D4H, C3D10 or C3D10H (C3D10H)")
    sub.add_argument("--across", type=_count, default=1, help="elements through each layer of the skin (1)")
    sub.add_argument(
        "--at", type=float, nargs=2, metavar=("X", "Y"), help="where the indenter comes down, mm (the pulp)"
    )

    sub = command(
        "mesh",
        "mesh a segmentation of any body (docs/any-body.md), or outlines in the plane (docs/regions.md)",
        "fingerfit mesh labels.nii.gz --labels 1=FAT,2=GLAND,3=LUMP --holes 4=TOP --size 8 --out body.inp",
    )
    sub.add_argument(
        "segmentation", type=Path, help="picture of labels (NIfTI, .seg.nrrd, ...); or outlines or a study (.yaml)"
    )
    sub.add_argument("--out", type=Path, required=True, help="the mesh (.inp)")
    sub.add_argument("--size", type=float, required=True, help="of elements at borders, mm")
    sub.add_argument("--labels", metavar="1=FAT,...", help="element set of each label (names of a .seg.nrrd; LABEL_1)")
    sub.add_argument("--holes", metavar="3=TOP,...", help="labels left out, as pads; nodes there become a node set")
    sub.add_argument("--base", metavar="SIDE", help="where node set BOTTOM is: x-, x+, y-, ... (last axis, -)")
    sub.add_argument("--indenter", metavar="SIDE", help="where node set TOP is (last axis, +)")
    sub.add_argument("--element", default="", help="C3D10, C3D10H, C3D4H, C3D4; CPE6, CPE6H, CPE3H, CPE3 (the first)")
    sub.add_argument("--grading", type=float, default=0.3, help="growth of elements away from borders, 0 to 1 (0.3)")

    sub = command(
        "morph",
        "bring the mesh of a finger (docs/fingertip.md) or of any other body (docs/any-body.md) to a subject's volume",
        "fingerfit morph reference.inp before.nii.gz --at 25.49 0 --out subject.inp",
    )
    sub.add_argument("reference", type=Path, help="mesh of the reference")
    sub.add_argument("volume", type=Path, help="subject before compression; a finger along x, its tip at the end")
    sub.add_argument("--out", type=Path, required=True, help="the subject's mesh (.inp)")
    sub.add_argument("--at", type=float, nargs=2, metavar=("X", "Y"), help="of a finger: where the indenter is, mm")
    sub.add_argument("--own", type=Path, metavar="VOLUME", help="of another body: the volume of the reference itself")
    sub.add_argument("--labels", metavar="1=EPIDERMIS,...", help="the volume is a segmentation with these labels")


def _add_models(command: Command) -> None:
    """What a user does with models and effects."""
    for name, text in (("add", "add an effect to the model"), ("drop", "take an effect out of the model")):
        sub = command(name, text, f"fingerfit {name} tilt")
        sub.add_argument("effect", help="name, as `fingerfit effects` lists them")
        sub.add_argument("--config", type=Path, default=Path("config.yaml"), help="settings (config.yaml)")

    sub = command(
        "profile",
        "hold a constant of a fitted model at other values, where all other numbers follow (docs/uncertainty.md)",
        "fingerfit profile mu_top",
    )
    sub.add_argument("constant", help="name, as in the table of the fit")
    sub.add_argument("--config", type=Path, default=Path("config.yaml"), help="settings (config.yaml)")
    sub.add_argument("--cores", type=_count, default=2)

    sub = command(
        "discover",
        "fit, diagnose and add the missing effect, until the model is adequate or no known effect explains the rest",
        "fingerfit discover --config config.yaml",
    )
    sub.add_argument("--config", type=Path, default=Path("config.yaml"), help="settings (config.yaml)")
    sub.add_argument("--cores", type=_count, default=2)

    sub = command(
        "export",
        "write fields (VTU), pictures (NIfTI) and tables (CSV) of a diagnosed model",
        "fingerfit export results/phantom/base",
    )
    sub.add_argument("model", type=Path, help="results/STUDY/MODEL")
    sub.add_argument("--out", type=Path, help="folder (MODEL/export)")

    sub = command("effects", "list the known effects", "fingerfit effects studies/phantom")
    sub.add_argument("study", type=Path, nargs="?", help="folder of a study with effects of its own")


def _add_deck(deck: argparse.ArgumentParser) -> None:
    sub = deck.add_subparsers(title="commands", required=True, metavar="COMMAND").add_parser(
        "show",
        help="write what the built-in solver understood of it",
        **_described("write a deck as the built-in solver understood it: flat, in its own numbers, as keywords", DECK),
    )
    sub.add_argument("deck", type=Path, metavar="DECK", help="the .inp file")
    sub.add_argument("--abaqus", action="store_true", help="its own lines as ABAQUS gets them, included files in place")
    sub.set_defaults(run=commands.show_deck)


def _add_workflow(command: Command) -> None:
    """What the workflow's rules call."""
    sub = command(
        "simulate",
        "solve one deck (for the workflow)",
        f"fingerfit simulate {SIM}/deck.inp --solver {SIM}/solver.json --out solution.npz",
    )
    sub.add_argument("deck", type=Path)
    sub.add_argument("--solver", type=Path, required=True)
    sub.add_argument("--out", type=Path, required=True)
    sub.add_argument("--threads", type=_count, default=1)
    sub.add_argument("--time-limit", type=int, default=0, help="seconds; 0: the solver's own")

    sub = command(
        "prepare",
        "read the measurements and make the meshes (for the workflow)",
        f"fingerfit prepare {RESULTS}/settings.json --out prepared.npz --mesh mesh.inp",
    )
    sub.add_argument("settings", type=Path)
    sub.add_argument("--out", type=Path, help="the measurements; needs --mesh")
    sub.add_argument("--mesh", type=Path, help="the mesh of the search")
    sub.add_argument("--refined", type=Path, help="the finer mesh of the last steps")
    sub.add_argument("--test", default="", help="which test of a study with several")

    sub = command(
        "settings",
        "write what is fitted to what in one model (for the workflow)",
        'fingerfit settings "$(cat settings.json)" --out checked.json',
    )
    sub.add_argument("given", help="settings of the model as JSON")
    sub.add_argument("--config", type=Path, default=Path("config.yaml"), help="named in errors (config.yaml)")
    sub.add_argument("--out", type=Path, required=True)

    last = f"{FIT} --last {RESULTS}/rounds/LAST.json"
    for name, text, options in (
        ("propose", "propose the next guesses (for the workflow)", f"{FIT} --out 0.json"),
        ("estimate", "constants with standard errors (for the workflow)", f"{last} --out e.json --table table.txt"),
        ("plot", "figures of a finished fit (for the workflow)", f"{last} --out figures"),
        (
            "diagnose",
            "where a fitted model fails and which effect it lacks (for the workflow)",
            f"{last} --estimate {RESULTS}/estimate.json --out {RESULTS}/diagnosis.json",
        ),
    ):
        sub = command(name, text, f"fingerfit {name} {options}")
        sub.add_argument("settings", type=Path)
        sub.add_argument("--data", type=Path, nargs="+", required=True, help="of each test, in their order")
        sub.add_argument("--mesh", type=Path, nargs="+", required=True)
        sub.add_argument("--refined", type=Path, nargs="+", default=())
        sub.add_argument("--sims", type=Path, required=True)
        sub.add_argument("--last", type=Path, required=name != "propose")
        sub.add_argument("--out", type=Path, required=True)
        if name == "propose":
            sub.add_argument("--solve", type=int, choices=(0, 1), default=0, help="1: solve short simulations here (0)")
        if name == "estimate":
            sub.add_argument("--table", type=Path, required=True)
        if name == "diagnose":
            sub.add_argument("--estimate", type=Path, required=True)
        if name in ("propose", "diagnose"):
            sub.add_argument("--time-limit", type=int, default=0, help="seconds; 0: the solver's own")
        if name in ("propose", "estimate", "diagnose"):
            sub.add_argument("--threads", type=_count, default=1)

    sub = command(
        "ladder",
        "put the rungs on the way to a model together, and write the page (for the workflow)",
        f"fingerfit ladder {RESULTS}/settings.json --out results/phantom/ladder.json --page report.html",
    )
    sub.add_argument("settings", type=Path, help="settings.json of the model")
    sub.add_argument("--out", type=Path, required=True, help="ladder.json in the folder of the study's results")
    sub.add_argument("--page", type=Path, required=True)


def main(arguments: list[str] | None = None) -> int:
    """Run a command; returns the exit code: 0, 1 for an error, 2 for wrong usage, 130 when interrupted."""
    words = sys.argv[1:] if arguments is None else arguments
    # what follows -- is for Snakemake
    cut = words.index("--") if words[:1] == ["run"] and "--" in words else len(words)
    parser = _parser()
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser)
    args = parser.parse_args(words[:cut])
    args.more = words[cut + 1 :]
    return exit_code(lambda: args.run(args))


def exit_code(work: Callable[[], object], program: str = "fingerfit") -> int:
    """Do something, and tell its errors as the command line does: one line for each, no traceback.

    Parameters
    ----------
    work : callable
        Without arguments; what it returns is not used.
    program : str
        What the lines begin with.

    Returns
    -------
    int
        0, 1 after an error, 130 when interrupted.
    """
    try:
        work()
        sys.stdout.flush()
    except BrokenPipeError:  # who reads the output has seen enough, as `head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except FingerfitError as error:
        lines = str(error).splitlines()
    except OSError as error:
        lines = [f"{error.filename}: " * bool(error.filename) + (error.strerror or str(error))]
    except MemoryError:
        lines = ["not enough memory"]
    except KeyboardInterrupt:
        return 130
    except Exception as error:  # the last resort: everything that is foreseen is one of the errors above
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        lines = [f"unexpected {what}; please report it{_kept_traceback()}"]
    else:
        return 0
    for line in lines:
        print(f"{program}: error: {line}", file=sys.stderr)
    return 1


def _kept_traceback() -> str:
    """Write the traceback of what is being handled to a file; says which one, nothing where there is no place."""
    lines = f"fingerfit {__version__}, Python {sys.version}\n{sys.argv}\n{traceback.format_exc()}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="fingerfit-", suffix=".txt", delete=False, encoding="utf-8"
        ) as handle:
            handle.write(lines)
    except OSError:
        return ""
    return f" with {handle.name}"


if __name__ == "__main__":
    sys.exit(main())
