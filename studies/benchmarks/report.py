"""The reports of three trained policies: how large they are, how fast they open, and what they look like.

    python -m studies.benchmarks.report [RUN...]     writes studies/results/report.json and docs/images/report/*.png

Without runs, those in runs/report are taken, and trained first where they are not there: CartPole-v1, LunarLander-v3
and MiniGrid-DoorKey-5x5-v0, about four minutes on two quiet cores. Two runs of CartPole are compared. Needs chromium
and the package playwright.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path
from statistics import median
from typing import Any

from PIL import Image

from sympol.cli.app import main as sympol
from sympol.runs.run import Run

from .timing import ROOT, arguments_of, write

RUNS = ROOT / "runs" / "report"
IMAGES = ROOT / "docs" / "images" / "report"
TRAINED: dict[str, list[str]] = {
    "cartpole": ["CartPole-v1"],
    "lunarlander": ["LunarLander-v3"],
    "doorkey": ["MiniGrid-DoorKey-5x5-v0"],
    "cartpole-network": ["CartPole-v1", "--policy", "mlp"],
}
COMPARED = ("cartpole", "cartpole-network")
STEPS = {"cartpole": 30, "lunarlander": 90, "doorkey": 4, "compare": 30}
"""Where the player stands in a picture."""
LOADS = 7
VIEWPORT: Any = {"width": 1280, "height": 940}
DARK = "lunarlander"


def main() -> None:
    """Write, measure, photograph."""
    parser = arguments_of(__doc__)
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN", help="the folder of a finished run")
    given = parser.parse_args()
    runs = {path.name: path for path in given.runs} or trained()
    pages = {name: RUNS / f"{name}.html" for name in runs if Run.open(runs[name]).has_tree}
    RUNS.mkdir(parents=True, exist_ok=True)
    for name, page in pages.items():
        properties = ROOT / "examples" / "safety" / f"{name}.toml"
        call(
            "report", str(runs[name]), "--out", str(page),
            *(["--properties", str(properties)] if properties.exists() else []),
        )  # fmt: skip
    if set(COMPARED) <= set(runs):
        pages["compare"] = RUNS / "compare.html"
        call("compare", *(str(runs[name]) for name in COMPARED), "--out", str(pages["compare"]))
    measured = look(pages)
    for name, row in measured.items():
        print(f"{name}: {row['kilobytes']:.0f} kB, {row['milliseconds']:.0f} ms, {row['elements']} elements")
    print("written to", write("report", {"loads": LOADS, "pages": measured}))


def trained() -> dict[str, Path]:
    for name, words in TRAINED.items():
        if not (RUNS / name / "summary.json").exists():
            call("train", *words, "--run-dir", str(RUNS / name), "--overwrite")
    return {name: RUNS / name for name in TRAINED}


def call(*words: str) -> None:
    if status := sympol(words):
        sys.exit(status)


def look(pages: dict[str, Path]) -> dict[str, dict[str, Any]]:
    """Open every page some times, and take its picture."""
    from playwright.sync_api import sync_playwright

    IMAGES.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        measured = {name: opened(browser, name, page) for name, page in pages.items()}
        measured = {name: row | {"browser": browser.version} for name, row in measured.items()}
        browser.close()
    return measured


def opened(browser: Any, name: str, path: Path) -> dict[str, Any]:
    """Load a page anew each time; the clock runs from the navigation to the end of its load event."""
    context = browser.new_context(viewport=VIEWPORT, color_scheme="dark" if name == DARK else "light")
    page = context.new_page()
    times = []
    for _ in range(LOADS):
        page.goto("about:blank")
        page.goto(path.as_uri())
        times.append(page.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd"))
    page.locator(".player .scrubber").focus()
    for _ in range(STEPS.get(name, 0)):
        page.keyboard.press("ArrowRight")
    page.locator("h1").click()
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.save(IMAGES / f"{name}.png", optimize=True)
    elements = page.evaluate("document.querySelectorAll('*').length")
    context.close()
    return {"kilobytes": path.stat().st_size / 1e3, "milliseconds": median(times), "elements": elements}


if __name__ == "__main__":
    main()
