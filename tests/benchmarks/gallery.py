"""The pictures of the manual's gallery, made anew: `python -m tests.benchmarks.gallery [NAME ...]`.

Each command of cosim/manual/gallery.md is run, and the figure of its page that the gallery shows is taken in the
system's Chromium. Some minutes; a name is that of a picture.
"""

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.support.browser import chromium as browsing
from tests.support.browser import open_page
from tests.support.needs import chromium
from tests.support.paths import ROOT

MANUAL = ROOT / "cosim" / "manual"
ENTRY = re.compile(
    r"```console\n\$ cosim (?P<words>.*)\n```\n\n!\[(?P<told>[^\]]+)\]\(pictures/(?P<name>[\w-]+)\.png\)"
)
"""A command of the gallery, the words for its picture, and the picture's name."""
SHOWN = {
    "contact": "#motion",
    "inverse-dynamics": "#inverse-dynamics-control figure",
    "contact-force": "#contact-force figure",
}
"""What of a page is shown, where it is not the first figure."""
MOMENT = {"contact": 1.3}
"""s: what the arms in motion show."""
WIDTH = 760


def entries() -> list[re.Match[str]]:
    """Every entry of the gallery."""
    return list(ENTRY.finditer((MANUAL / "gallery.md").read_text(encoding="utf-8")))


def picture(browser, entry: re.Match[str], folder: Path) -> int:
    """Run the command of an entry and take its picture; its size in bytes."""
    name = entry["name"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    words = [sys.executable, "-m", "cosim", *shlex.split(entry["words"]), "--out", str(folder / name)]
    subprocess.run(words, env=environment, check=True, capture_output=True)
    target = MANUAL / "pictures" / f"{name}.png"
    target.parent.mkdir(exist_ok=True)
    with open_page(browser, folder / name / "report.html", viewport={"width": WIDTH, "height": 900}) as page:
        part = page.locator(SHOWN.get(name, "#figure-1")).first
        part.scroll_into_view_if_needed()
        if name in MOMENT:
            page.evaluate(f"motion.set({MOMENT[name]})")
        page.wait_for_timeout(300)
        part.screenshot(path=target)
    return target.stat().st_size


def main() -> None:
    """Take the pictures that are named, or all."""
    wanted = sys.argv[1:]
    with tempfile.TemporaryDirectory() as folder, browsing(chromium() or "chromium") as browser:
        for entry in entries():
            if not wanted or entry["name"] in wanted:
                print(f"{entry['name']}: {picture(browser, entry, Path(folder)) / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
