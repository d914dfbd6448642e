"""Pictures of the tutorial from a report, by headless Chromium.

    python docs/pictures/make.py results/hidden-tilt/report.html

Each shows one section of the page, of the model without any effect, as a reader sees it.
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


def main(report: Path, out: Path) -> None:
    """Write a picture for each section."""
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
            picture = Image.open(shot).convert("RGB")
            picture = picture.quantize(COLOURS)
            picture.save(out / f"{name}.png", optimize=True)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]), Path(__file__).resolve().parent)
