# SPDX-License-Identifier: Apache-2.0
"""Visits the live page with Chromium and prints what was seen, as JSON: a program, so that no browser is left behind.

python tests/browser_visit.py URL CHROMIUM FOLDER [SECONDS]; screenshots go to FOLDER, pictures are counted for SECONDS.
Without FOLDER: of a run that has ended.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

DESKTOP: Any = {"width": 1280, "height": 900}
PHONE: Any = {"width": 390, "height": 844}
TEXTS = ("link", "power", "mode", "reason", "excitation", "frequency", "beam", "efficiency", "height", "run", "grain")
TIMEOUT = 120.0  # [s]


def until(page: Any, expression: str) -> None:
    """Wait until an expression is true in the page, whose policy forbids `wait_for_function`."""
    deadline = time.monotonic() + TIMEOUT
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"{expression}: {page.evaluate('live.state')}"
        page.wait_for_timeout(50)


def pictures(page: Any, seconds: float) -> float:
    """Return the pictures a second over some time."""
    begun = page.evaluate("[performance.now(), live.pictures]")
    page.wait_for_timeout(1000.0 * seconds)
    until(page, f"live.pictures > {begun[1]}")
    ended = page.evaluate("[performance.now(), live.pictures]")
    return float(1000.0 * (ended[1] - begun[1]) / (ended[0] - begun[0]))


def visit(url: str, chromium: str, folder: Path, seconds: float) -> dict[str, Any]:
    """Return what was seen."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        errors: list[str] = []
        desktop = browser.new_page(viewport=DESKTOP)
        desktop.on("pageerror", lambda error: errors.append(str(error)))
        desktop.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        desktop.goto(url)
        until(desktop, "live.pictures > 0 && live.rows.efficiency.length > 5 && live.spectrum.frequency.length")
        phone = browser.new_page(viewport=PHONE, has_touch=True, is_mobile=True)
        phone.goto(url)
        until(phone, "live.pictures > 10")
        phone.screenshot(path=folder / "phone.png", full_page=True)
        width = phone.evaluate("document.documentElement.scrollWidth")
        on_phone = pictures(phone, seconds)
        phone.close()
        seen = {"pictures": [pictures(desktop, seconds), on_phone], "phone_width": width, "errors": errors}
        desktop.keyboard.press("Tab")
        seen["first_focus"] = desktop.evaluate("document.activeElement.id")
        desktop.fill("#note", "seen in a browser")
        desktop.keyboard.press("Enter")
        until(desktop, "live.answer")
        seen["note"] = desktop.evaluate("live.answer.words")
        until(desktop, "document.getElementById('events').textContent.includes('seen in a browser')")
        found = Axe().run(desktop).response["violations"]
        seen["findings"] = [f"{one['id']}: {one['impact']}" for one in found]
        seen["serious"] = [one["id"] for one in found if one["impact"] in ("serious", "critical")]
        seen["texts"] = {name: desktop.text_content(f"#{name}") for name in TEXTS}
        desktop.screenshot(path=folder / "desktop.png", full_page=True)
        dark = browser.new_page(viewport=DESKTOP, color_scheme="dark")
        dark.goto(url)
        until(dark, "live.pictures > 0")
        found = Axe().run(dark).response["violations"]
        seen["serious"] += [f"dark: {one['id']}" for one in found if one["impact"] in ("serious", "critical")]
        dark.screenshot(path=folder / "dark.png", full_page=True)
        seen["running"] = look(dark)
        dark.click("#stop")
        until(dark, "live.answer && live.state.motor.mode === 'disarmed'")
        seen["stopped"] = look(dark) | {"answer": dark.text_content("#answer")}
        browser.close()
        return seen


def look(page: Any) -> dict[str, Any]:
    """Return what the page shows of its connection, and which buttons may be pressed."""
    buttons = (
        "[...document.querySelectorAll('button')].filter((each) => !each.disabled).map((each) => each.textContent)"
    )
    return {
        "link": page.text_content("#link"), "class": page.get_attribute("#link", "class"),
        "buttons": page.evaluate(buttons), "over": page.evaluate("document.body.classList.contains('over')"),
        "weight": page.evaluate("getComputedStyle(document.getElementById('beam')).fontWeight"),
    }  # fmt: skip


def ended(url: str, chromium: str) -> dict[str, Any]:
    """Return what a page shows of a run that has ended."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page(viewport=DESKTOP)
        page.goto(url)
        until(page, "live.state && live.state.finished && document.body.dataset.open === 'true'")
        shown = look(page)
        browser.close()
        return shown


if __name__ == "__main__":
    given = sys.argv[1:]
    if len(given) == 2:
        print(json.dumps(ended(*given)))
        sys.exit()
    print(json.dumps(visit(given[0], given[1], Path(given[2]), float(given[3]) if len(given) > 3 else 1.0)))
