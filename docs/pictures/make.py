"""Pictures of the documentation: the loop, the tutorial's from a report by headless Chromium, and a fit's own figures.

    python docs/pictures/make.py loop
    python docs/pictures/make.py results/hidden-tilt/report.html
    python docs/pictures/make.py results/fingertip/layered+indenter_place/figures/pictures.png fingertip_layered

The first shows one guess for the phantom on its way round; the second ones show one section of the page each, of the
model without any effect, as a reader sees it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from PIL import Image

from fingerfit.fit.jobs import solve_missing
from fingerfit.fit.simulate import begin
from fingerfit.report.drawing import draw_mesh, extent, save
from fingerfit.settings.config import load_settings

ROOT = Path(__file__).resolve().parents[2]
GUESS = {"mu_top": 0.05, "mu_middle": 0.05, "mu_bottom": 0.05}
"""Guess that is shown, MPa: too stiff, so that the difference can be seen."""
SECTIONS = ("compare", "fails", "missing", "ladder")
WIDTH, HEIGHT, COLOURS = 1300, 940, 256
"""Of the upper part of a section, px."""
FIGURE = 900
"""Width of a figure, px."""


def loop(out: Path) -> None:
    """Draw the loop: one guess with its deck, simulation, synthesized picture, difference, and the way to the next."""
    settings = load_settings(ROOT / "config.yaml")
    settings = settings.model_copy(update={"study": str(ROOT / settings.study)})
    with tempfile.TemporaryDirectory() as folder:
        problem, _ = begin(settings, Path(folder))
        asked = problem.ask(GUESS)
        solve_missing(problem, [asked], 1)
        outcome, made, mesh = problem.outcome(asked), problem.prediction(asked), problem.meshes["search"]
    data, start = problem.data, asked.deck.index("*MATERIAL")
    lines = asked.deck[start:].splitlines()[:12]
    figure = Figure(figsize=(11.0, 6.6))
    panel = _Panels(figure)
    panel.text(0, 1, "1  guess", "constants of each layer", "\n".join(f"{n:<11}{v} MPa" for n, v in GUESS.items()), 11)
    panel.text(1, 1, "2  deck", "input of the FE program", "\n".join([*lines, "..."]), 7)
    (axes,) = panel.pictures(2, 1, "3  simulation", "displacements at the measured force", [""])
    draw_mesh(axes, mesh, mesh.points + outcome.displacement[-1])
    left, right, low, high = extent(data)
    axes.set(xlim=(left, right), ylim=(low, high))
    grey = {"cmap": "gray", "vmin": 0.0, "vmax": float(data.before.max()), "origin": "lower", "extent": extent(data)}
    two = panel.pictures(2, 0, "4  warp", "displacements applied to the picture", ["before compression", "synthesized"])
    for axes, picture in zip(two, (data.before, made.pictures[-1]), strict=True):
        axes.imshow(picture, **grey)
    two = panel.pictures(1, 0, "5  compare", "score: NMI or SSD", ["measured", "measured - synthesized"])
    two[0].imshow(data.measured[-1], **grey)
    difference = data.measured[-1] - made.pictures[-1]
    limit = float(abs(difference).max())
    two[1].imshow(difference, **{**grey, "cmap": "RdBu_r", "vmin": -limit, "vmax": limit})
    words = "the downhill simplex\nproposes new constants,\nuntil both tolerances\n(tolx, tolf) are met"
    panel.text(0, 0, "6  next guess", "from all scores so far", words, 11)
    for start, end in (
        ((0, 1), (1, 1)),
        ((1, 1), (2, 1)),
        ((2, 1), (2, 0)),
        ((2, 0), (1, 0)),
        ((1, 0), (0, 0)),
        ((0, 0), (0, 1)),
    ):
        panel.arrow(start, end)
    save(figure, out / "loop.png")
    shrink(out / "loop.png", out / "loop.png", WIDTH)


class _Panels:
    """Boxes in three columns and two rows, the lower row 0; lengths are shares of the figure."""

    WIDE, HIGH, GAP_X, GAP_Y, EDGE = 0.29, 0.43, 0.05, 0.09, 0.015

    def __init__(self, figure: Figure) -> None:
        self.figure = figure

    def corner(self, column: int, row: int) -> tuple[float, float]:
        """Lower left corner of a box."""
        return self.EDGE + column * (self.WIDE + self.GAP_X), self.EDGE + 0.01 + row * (self.HIGH + self.GAP_Y)

    def box(self, column: int, row: int, title: str, under: str) -> tuple[float, float]:
        """Draw a box with its two lines of heading; returns its corner."""
        x, y = self.corner(column, row)
        style = "round,pad=0,rounding_size=0.01"
        self.figure.add_artist(
            FancyBboxPatch((x, y), self.WIDE, self.HIGH, style, facecolor="#f4f6f8", edgecolor="#66707a", zorder=-1)
        )
        self.figure.text(x + 0.012, y + self.HIGH - 0.045, title, fontsize=13, weight="bold")
        self.figure.text(x + 0.012, y + self.HIGH - 0.085, under, fontsize=9.5, color="#444444")
        return x, y

    def text(self, column: int, row: int, title: str, under: str, words: str, size: float) -> None:
        """Draw a box of text."""
        x, y = self.box(column, row, title, under)
        family = "monospace" if row else "sans-serif"
        middle = y + (self.HIGH - 0.1) / 2
        self.figure.text(x + 0.02, middle, words, fontsize=size, family=family, va="center", linespacing=1.5)

    def pictures(self, column: int, row: int, title: str, under: str, names: list[str]) -> list[Any]:
        """Draw a box with room for pictures beside each other; returns their axes."""
        x, y = self.box(column, row, title, under)
        wide = (self.WIDE - 0.01 * (len(names) + 1)) / len(names)
        found = []
        for number, name in enumerate(names):
            axes = self.figure.add_axes((x + 0.01 + number * (wide + 0.01), y + 0.045, wide, self.HIGH - 0.15))
            axes.set(xticks=[], yticks=[], anchor="C")
            axes.set_xlabel(name, fontsize=9)
            found.append(axes)
        return found

    def arrow(self, start: tuple[int, int], end: tuple[int, int]) -> None:
        """Draw an arrow between the facing sides of two boxes."""
        (x0, y0), (x1, y1) = self.corner(*start), self.corner(*end)
        across, up = (end[0] > start[0]) - (end[0] < start[0]), (end[1] > start[1]) - (end[1] < start[1])
        middle = (self.WIDE / 2, self.HIGH / 2)
        tail = (x0 + middle[0] * (1 + across), y0 + middle[1] * (1 + up))
        head = (x1 + middle[0] * (1 - across), y1 + middle[1] * (1 - up))
        self.figure.add_artist(
            FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=24, linewidth=2.5, color="#0072B2")
        )


def main(report: Path, out: Path) -> None:
    """Write a picture for each section of a report."""
    binary = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chromium-browser"))), None)
    if binary is None:
        sys.exit("no Chromium is installed")
    # the page's policy runs no script but its own, and takes no other style
    text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", report.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        for name in SECTIONS:
            hidden = f"body > header, main > :not(#{name}), nav, footer"
            alone = f"<style>{hidden} {{display: none}}</style>"
            first = "<script>document.querySelector('button[data-model=\"base\"]')?.click()</script>"
            page, shot = Path(folder) / f"{name}.html", Path(folder) / f"{name}.png"
            page.write_text(text.replace("</head>", f"{alone}</head>").replace("</body>", f"{first}</body>"), "utf-8")
            subprocess.run(
                [binary, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder}/profile",
                 "--hide-scrollbars", f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={shot}",
                 "--virtual-time-budget=4000", page.as_uri()],
                check=True, capture_output=True, timeout=120,
            )  # fmt: skip
            shrink(shot, out / f"{name}.png", WIDTH)


def shrink(picture: Path, out: Path, width: int) -> None:
    """Write a picture with few colours, no wider than this."""
    found = Image.open(picture).convert("RGB")
    found.thumbnail((width, found.height))
    found.quantize(COLOURS).save(out, optimize=True)


if __name__ == "__main__":
    here = Path(__file__).resolve().parent
    if sys.argv[1:] == ["loop"]:
        loop(here)
    elif len(sys.argv) == 2:
        main(Path(sys.argv[1]), here)
    elif len(sys.argv) == 3:
        shrink(Path(sys.argv[1]), here / f"{sys.argv[2]}.png", FIGURE)
    else:
        sys.exit(__doc__)
