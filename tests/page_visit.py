# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Opens pages with Chromium and prints what was seen, as JSON: a program, so that no browser is left behind.

python tests/page_visit.py CHROMIUM pages PAGE...: each is looked at on a desktop and on a phone, light and dark.
python tests/page_visit.py CHROMIUM operate URL: the live page of a bench that runs.
python tests/page_visit.py CHROMIUM still URL: a live page that does not change.
"""

import importlib.util
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from atpid_common.testing import PATIENCE

DESKTOP: Any = {"width": 1280, "height": 900}
PHONE: Any = {"width": 390, "height": 844}
#: By screen: its size, and the scheme in which a page is opened, then the one it is switched to.
SCREENS: Any = {"desktop": (DESKTOP, ("light", "dark")), "phone": (PHONE, ("dark", "light"))}
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
#: What the live page shows in words.
TEXTS = ("power", "excitation", "frequency", "beam", "bare", "reduction", "closed", "efficiency", "h-now")
#: Connection, its style, the buttons that may be pressed, and whether the run is over.
LOOK = """() => ({
  link: document.getElementById("link").textContent, class: document.getElementById("link").className,
  buttons: [...document.querySelectorAll("button")].filter((each) => !each.disabled).map((each) => each.textContent),
  over: document.body.classList.contains("over"),
})"""
#: Presses the button without a connection, at once: another one comes after a second.
UNSENT = "() => { live.stream.close(); document.getElementById('stop').onpointerdown(); return live.answer.words; }"


def visited(*pages: Path) -> dict[str, list[str]]:
    """Return what is wrong with each page, `PAGE SCREEN SCHEME` -> findings; skips the test without a browser."""
    found: dict[str, list[str]] = live("pages", *pages)
    return found


def live(kind: str, *words: object) -> Any:
    """Return what is seen of the live page; skips the test without a browser."""
    import pytest

    chromium = shutil.which("chromium")
    if chromium is None or importlib.util.find_spec("playwright") is None:
        pytest.skip("left out: a browser draws the page; Chromium or playwright is missing: sudo make browser")
    command = [sys.executable, __file__, chromium, kind, *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=5.0 * PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


class Browser:
    """Chromium, whose pages wait longer than Playwright does by itself: the machine may be busy."""

    def __init__(self, chromium: Any) -> None:
        self.chromium = chromium
        self.errors: list[str] = []  # of the pages' scripts

    def open(self, url: str, **options: Any) -> Any:
        page = self.chromium.new_page(**options)
        page.set_default_timeout(1e3 * PATIENCE)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        page.goto(url)
        return page


@contextmanager
def browsing(path: str) -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield Browser(chromium)
        chromium.close()


def wrong(page: Any) -> list[str]:
    from axe_playwright_python.sync_playwright import Axe

    return [f"{one['id']}: {one['impact']}" for one in Axe().run(page).response["violations"]]


def until(page: Any, expression: str) -> None:
    """Wait until an expression is true in the page, whose policy forbids `wait_for_function`."""
    deadline = time.monotonic() + PATIENCE
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"{expression}: {page.evaluate('[live.pressed, live.answer, live.state]')}"
        page.wait_for_timeout(50)


def look_at(browser: Browser, *pages: str) -> dict[str, list[str]]:
    found = {}
    for name in pages:
        for screen, (size, schemes) in SCREENS.items():
            page = browser.open(Path(name).resolve().as_uri(), viewport=size, color_scheme=schemes[0])
            for scheme in schemes:
                page.emulate_media(color_scheme=scheme)
                findings = wrong(page)
                if page.evaluate("document.documentElement.scrollWidth") > size["width"]:
                    findings.append("scrolls sideways")
                found[f"{Path(name).name} {screen} {scheme}"] = findings + page.evaluate(MISPLACED) + browser.errors
            page.close()
            browser.errors.clear()
    return found


def operate(browser: Browser, url: str) -> dict[str, Any]:
    """Return what is seen of the live page while an operator uses it."""
    desktop = browser.open(url, viewport=DESKTOP)
    until(desktop, "live.pictures > 0 && live.rows.efficiency.length > 5 && live.spectrum.frequency.length")
    seen: dict[str, Any] = {}
    desktop.fill("#note", "seen in a browser")
    desktop.keyboard.press("Enter")
    until(desktop, "live.answer")
    seen["note"] = desktop.evaluate("live.answer.words")
    until(desktop, "document.getElementById('events').textContent.includes('seen in a browser')")
    findings = wrong(desktop)
    seen["texts"] = {name: desktop.text_content(f"#{name}") for name in TEXTS}
    desktop.close()
    dark = browser.open(url, viewport=DESKTOP, color_scheme="dark")
    until(dark, "live.pictures > 0 && document.getElementById('link').textContent === 'Connected'")
    seen["running"] = dark.evaluate(LOOK)
    dark.click("#stop")
    until(dark, "live.answer?.success && live.state.motor.mode === 'disarmed'")
    seen["stopped"] = dark.evaluate(LOOK) | {"answer": dark.text_content("#answer")}
    errors = list(browser.errors)  # before the connection is ended
    seen["unsent"] = dark.evaluate(UNSENT)
    until(dark, "live.answer.success")
    return seen | {"findings": findings, "errors": errors}


def still(browser: Browser, url: str) -> dict[str, Any]:
    """Return what a live page shows that does not change: of a run that has ended, or of a view without a graph."""
    page = browser.open(url, viewport=DESKTOP)
    until(page, "live.state && document.getElementById('run').textContent !== '–'")
    shown: dict[str, Any] = page.evaluate(LOOK)
    shown["texts"] = {name: page.text_content(f"#{name}") for name in TEXTS}
    return shown


def main(chromium: str, kind: str, *words: str) -> None:
    kinds: dict[str, Callable[..., Any]] = {"pages": look_at, "operate": operate, "still": still}
    with browsing(chromium) as browser:
        print(json.dumps(kinds[kind](browser, *words)))


if __name__ == "__main__":
    main(*sys.argv[1:])
