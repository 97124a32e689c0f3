"""Sizes of pages, seconds to make them and seconds until they can be used in a browser, here and in another tree.

    python -m tests.benchmarks.pages [TREE ...]      # folders of other versions of this project; some minutes a tree

Each kind is made by a process of its own, so that imports count; `make` is the time of saving result and page together.
`ready`: from the address to the second frame after everything is drawn, in the system's Chromium, the least of five;
`its cpu`: processor time of the page's main thread until then, which a busy machine does not change. A version that has
no such page has dashes.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.support.browser import chromium as browsing
from tests.support.needs import chromium
from tests.support.paths import ROOT

PENDULUM = ROOT / "tests" / "data" / "dfki_pendulum_1dof"
RECORDING = f"{str(PENDULUM / 'ddp.csv')!r}, description={str(PENDULUM / 'dfki_pendulum_1dof.toml')!r}"
LONG = '{"experiment.stop": 500.0, "experiment.record_every": 1}'
KINDS = {
    "run": 'cosim.run("contact")',
    "run, 500,000 rows": f'cosim.run(cosim.load("sallam-stable").with_values({LONG}))',
    "stability": 'cosim.stability("sallam-unstable")',
    "sweep": 'cosim.sweep("parameter-sets", workers=2)',
    "identification": f"cosim.identify({RECORDING})",
    "closure": f"cosim.close_loop({RECORDING}, replay=False)",
    "data": f"cosim.data({RECORDING})",
    "compare": 'cosim.compare([cosim.run("sallam-nodelay"), cosim.run("sallam-stable")], tolerance=0.1)',
    "live": 'cosim.live("sallam-stable", sys.argv[1], stability_map=False)',
}
ARM = {"workspace": "workspace", "dissection": "dissect", "counterbalance": "counterbalance"}
MAKE = """
import json, os, sys, time
import cosim
start, used = time.perf_counter(), time.process_time()
made = {expression}
if hasattr(made, "save"):
    start, used = time.perf_counter(), time.process_time()
    made.save(sys.argv[1])
print(json.dumps([time.perf_counter() - start, time.process_time() - used]))
"""


def made(tree: Path, kind: str, folder: Path) -> tuple[float, float] | None:
    """Seconds, and those of the processor, that saving takes in a tree; a command of the arm is timed as a whole. None
    where the tree cannot do it.
    """
    environment = os.environ | {"PYTHONPATH": str(tree)}
    start = time.perf_counter()
    if kind in ARM:
        words = ["-m", "cosim", "arm", ARM[kind], "--out", str(folder)]
    else:
        words = ["-c", MAKE.format(expression=KINDS[kind]), str(folder)]
    before = os.times()
    done = subprocess.run([sys.executable, *words], cwd=tree, env=environment, capture_output=True, text=True)
    after = os.times()
    if done.returncode:
        print(done.stderr.rpartition("Error")[2].strip() or done.stderr, file=sys.stderr)
        return None
    if kind in ARM:
        return time.perf_counter() - start, after.children_user - before.children_user
    wall, used = json.loads(done.stdout.splitlines()[-1])
    return wall, used


def ready(browser, page_file: Path) -> tuple[float, float]:
    """Seconds from the address to the second frame after everything is drawn, and those of the page's main thread."""
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    start = time.perf_counter()
    page.goto(page_file.as_uri())
    if "dataset.ready" in page_file.read_text(encoding="utf-8"):
        page.wait_for_selector("html[data-ready]", state="attached")
    page.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    seconds = time.perf_counter() - start
    told = {entry["name"]: entry["value"] for entry in session.send("Performance.getMetrics")["metrics"]}
    page.close()
    return seconds, told["TaskDuration"]


def line(browser, tree: Path, kind: str, out: Path) -> str:
    """A row of the table."""
    times = made(tree.resolve(), kind, out)
    page = next((out / name for name in ("report.html", "live.html") if (out / name).is_file()), None)
    if times is None or page is None:
        return f"{kind:20s} {tree.name:>24s} {'-':>6s}"
    shown = [ready(browser, page) for _ in range(5)]
    size, seconds, used = page.stat().st_size / 1e6, min(s for s, _ in shown), min(u for _, u in shown)
    return f"{kind:20s} {tree.name:>24s} {size:6.2f} {times[0]:9.2f} {times[1]:8.2f} {seconds:9.2f} {used:8.2f}"


def main() -> None:
    trees = [ROOT, *map(Path, sys.argv[1:])]
    names = f"{'page':20s} {'tree':>24s} {'MB':>6s} {'make [s]':>9s} {'cpu [s]':>8s} {'ready [s]':>9s} {'its cpu':>8s}"
    print(names)
    with tempfile.TemporaryDirectory() as folder, browsing(chromium() or "chromium") as browser:
        ready_once = Path(folder) / "empty.html"
        ready_once.write_text("<p>")
        ready(browser, ready_once)  # the first page of a browser pays for its start
        for kind in (*KINDS, *ARM):
            for tree in trees:
                print(line(browser, tree, kind, Path(folder) / kind.replace(", ", "-") / tree.name), flush=True)


if __name__ == "__main__":
    main()
