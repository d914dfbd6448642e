"""Pictures of the documentation: of the tutorial from a report, by headless Chromium, and a fit's own figures.

    python docs/pictures/make.py results/hidden-tilt/report.html
    python docs/pictures/make.py results/fingertip/layered+indenter_place/figures/pictures.png fingertip_layered

The first show one section of the page each, of the model without any effect, as a reader sees it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

SECTIONS = ("compare", "fails", "missing", "ladder")
WIDTH, HEIGHT, COLOURS = 1300, 940, 256
"""Of the upper part of a section, px."""
FIGURE = 900
"""Width of a figure, px."""


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
    if len(sys.argv) == 2:
        main(Path(sys.argv[1]), here)
    elif len(sys.argv) == 3:
        shrink(Path(sys.argv[1]), here / f"{sys.argv[2]}.png", FIGURE)
    else:
        sys.exit(__doc__)
