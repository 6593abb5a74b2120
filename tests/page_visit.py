# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Opens pages with Chromium and prints what is wrong with them, as JSON: a program, so that no browser is left behind.

python tests/page_visit.py CHROMIUM PAGE...; each is looked at on a desktop and on a phone, light and dark.
"""

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

SCREENS: Any = {"desktop": {"width": 1280, "height": 900}, "phone": {"width": 390, "height": 844}}
SCHEMES: Any = {"desktop": ("light", "dark"), "phone": ("dark", "light")}
TIMEOUT = 120.0  # [s] for a page to load
#: Texts of the charts that leave the screen, and names of curves that stand within the panels.
MISPLACED = """() => {
  const box = (item) => item.getBoundingClientRect();
  const texts = ".annotation-text, .xtick text, .ytick text, .panels text, .sketch text";
  const shown = [...document.querySelectorAll(texts)];
  const outside = shown.filter((item) => box(item).left < 0 || box(item).right > innerWidth);
  const panels = [...document.querySelectorAll(".bglayer .bg")].map(box);
  const meet = (a, b) => a.left < b.right && a.right > b.left && a.top < b.bottom && a.bottom > b.top;
  const names = ["closed", "adaptive", "true", "identified", "commanded", "moved", "floor", "grain", "ceiling"];
  const named = shown.filter((item) => names.includes(item.textContent));
  const covering = named.filter((item) => panels.some((panel) => meet(box(item), panel)));
  return [...outside, ...covering].map((item) => item.textContent);
}"""


def visited(*pages: Path) -> dict[str, list[str]]:
    """Return what is wrong with each page, `PAGE SCREEN SCHEME` -> findings; skips the test without a browser."""
    import pytest

    chromium = shutil.which("chromium")
    if chromium is None or importlib.util.find_spec("playwright") is None:
        pytest.skip("left out: a browser draws the page; Chromium or playwright is missing: sudo make browser")
    command = [sys.executable, __file__, chromium, *map(str, pages)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=500.0)
    assert done.returncode == 0, done.stderr
    found: dict[str, list[str]] = json.loads(done.stdout)
    return found


def new_page(browser: Any, **options: Any) -> Any:
    """Open an empty page, which waits longer than Playwright does by itself: the machine may be busy."""
    page = browser.new_page(**options)
    page.set_default_timeout(1e3 * TIMEOUT)
    return page


def errors_of(page: Any) -> list[str]:
    """Return a list to which errors of the page's scripts are appended."""
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    return errors


def main(chromium: str, *pages: str) -> None:
    """Print what is wrong with each page."""
    from axe_playwright_python.sync_playwright import Axe
    from playwright.sync_api import sync_playwright

    found = {}
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name in pages:
            for screen, size in SCREENS.items():
                page = new_page(browser, viewport=size)
                errors = errors_of(page)
                # a desktop opens the page in the light and a phone in the dark; then each is switched over
                for place, scheme in enumerate(SCHEMES[screen]):
                    page.emulate_media(color_scheme=scheme)
                    if place == 0:
                        page.goto(Path(name).resolve().as_uri())
                    wrong = [one["id"] for one in Axe().run(page).response["violations"]]
                    if page.evaluate("document.documentElement.scrollWidth") > size["width"]:
                        wrong.append("scrolls sideways")
                    found[f"{Path(name).name} {screen} {scheme}"] = wrong + page.evaluate(MISPLACED) + errors
                page.close()
        browser.close()
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:])
