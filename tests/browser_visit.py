# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Visits the live page with Chromium and prints what was seen, as JSON: a program, so that no browser is left behind.

python tests/browser_visit.py URL CHROMIUM FOLDER [SECONDS]; screenshots go to FOLDER, pictures are counted for SECONDS.
Without FOLDER: of a page that does not change.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

from axe_playwright_python.sync_playwright import Axe
from page_visit import TIMEOUT, new_page
from playwright.sync_api import sync_playwright

DESKTOP: Any = {"width": 1280, "height": 900}
PHONE: Any = {"width": 390, "height": 844}
TEXTS = (
    "link", "power", "mode", "reason", "excitation", "frequency", "beam", "bare", "reduction", "closed", "efficiency",
    "height", "run", "grain", "hold", "h-now",
)  # fmt: skip
PLOTS = ("motion", "plot-efficiency", "plot-spectrum")
#: Widths of a window [pixels], one for each number of columns of the page and some more.
WIDTHS = (390, 800, 1280, 1440, 1920)
#: Whether the button that stops the motor stays where it is while a long line appears beside it.
STAYS = """() => { const lost = document.getElementById("lost"), text = lost.textContent, hidden = lost.hidden;
    const place = () => { const at = document.getElementById("stop").getBoundingClientRect(); return [at.x, at.y]; };
    const before = place();
    lost.hidden = false; lost.textContent = "silent ".repeat(60);
    const after = place();
    lost.hidden = hidden; lost.textContent = text;
    return before[0] === after[0] && before[1] === after[1]; }"""
#: Presses the button without a connection, at once: another one comes after a second.
UNSENT = "() => { live.stream.close(); document.getElementById('stop').onpointerdown(); return live.answer.words; }"


def until(page: Any, expression: str) -> None:
    """Wait until an expression is true in the page, whose policy forbids `wait_for_function`."""
    deadline = time.monotonic() + TIMEOUT
    while not page.evaluate(expression):
        assert time.monotonic() < deadline, f"{expression}: {page.evaluate('[live.pressed, live.answer, live.state]')}"
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
        desktop = new_page(browser, viewport=DESKTOP)
        desktop.on("pageerror", lambda error: errors.append(str(error)))
        desktop.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        desktop.goto(url)
        until(desktop, "live.pictures > 0 && live.rows.efficiency.length > 5 && live.spectrum.frequency.length")
        phone = new_page(browser, viewport=PHONE, has_touch=True, is_mobile=True)
        phone.goto(url)
        until(phone, "live.pictures > 10")
        phone.screenshot(path=folder / "phone.png", full_page=True)
        width = phone.evaluate("document.documentElement.scrollWidth")
        on_phone, findings = pictures(phone, seconds), wrong(phone)
        phone.close()
        seen = {"pictures": [pictures(desktop, seconds), on_phone], "phone_width": width, "errors": errors}
        desktop.keyboard.press("Tab")
        seen["first_focus"] = desktop.evaluate("document.activeElement.id")
        desktop.fill("#note", "seen in a browser")
        desktop.keyboard.press("Enter")
        until(desktop, "live.answer")
        seen["note"] = desktop.evaluate("live.answer.words")
        until(desktop, "document.getElementById('events').textContent.includes('seen in a browser')")
        findings += wrong(desktop)
        seen["texts"] = texts(desktop)
        desktop.screenshot(path=folder / "desktop.png", full_page=True)
        desktop.close()
        dark = new_page(browser, viewport=DESKTOP, color_scheme="dark")
        dark.goto(url)
        until(dark, "live.pictures > 0 && document.getElementById('link').textContent === 'Connected'")
        dark.screenshot(path=folder / "dark.png", full_page=True)
        seen["stop_stays"] = []
        for size in (PHONE, DESKTOP):
            dark.set_viewport_size(size)
            seen["stop_stays"].append(dark.evaluate(STAYS))
            findings += [f"dark: {one}" for one in wrong(dark)]
        seen["running"] = look(dark)
        dark.click("#stop")
        until(dark, "live.answer?.success && live.state.motor.mode === 'disarmed'")
        seen["findings"] = findings
        seen["stopped"] = look(dark) | {"answer": dark.text_content("#answer")}
        seen["unsent"] = dark.evaluate(UNSENT)
        until(dark, "live.answer.success")
        browser.close()
        return seen


def wrong(page: Any) -> list[str]:
    """Return what axe finds on the page."""
    return [f"{one['id']}: {one['impact']}" for one in Axe().run(page).response["violations"]]


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


def texts(page: Any) -> dict[str, str]:
    """Return the texts of the page."""
    return {name: page.text_content(f"#{name}") for name in TEXTS}


def plot(page: Any, name: str) -> dict[str, Any]:
    """Return abscissas and ordinates of each line, and the ranges of the axes."""
    shown: dict[str, Any] = page.evaluate(
        """(name) => { const { data, _fullLayout: axes } = document.getElementById(name);
        return { lines: data.map((line) => [line.x, line.y]), x: axes.xaxis.range,
        y: axes.yaxis.range, type: axes.yaxis.type }; }""",
        name,
    )
    return shown


def gaps(page: Any) -> list[float]:
    """Return the width [pixels] of the page's rows, each with its gaps, that no section covers."""
    found: list[float] = page.evaluate(
        """() => { const rows = new Map(), main = document.querySelector("main").getBoundingClientRect();
        for (const section of document.querySelectorAll("main > section")) {
          const { top, width } = section.getBoundingClientRect();
          rows.set(top, (rows.get(top) ?? main.width - 12) - width - 12);
        }
        return [...rows.values()]; }"""
    )
    return found


def still(url: str, chromium: str) -> dict[str, Any]:
    """Return what a page shows that does not change: of a run that has ended, or of a view without a graph."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = new_page(browser, viewport=DESKTOP)
        page.goto(url)
        until(page, "live.state && document.getElementById('run').textContent !== '–'")
        shown = look(page) | {"texts": texts(page)}
        if page.evaluate("live.rows.motion.length"):
            for name in PLOTS if page.evaluate("live.rows.efficiency.length") else PLOTS[:1]:
                until(page, f"document.getElementById('{name}').data[0].x.length")
            shown["plots"] = {name: plot(page, name) for name in PLOTS}
            shown["scale"] = page.text_content("#picture text")
            shown["classes"] = {name: page.get_attribute(f"#{name}", "class") for name in ("reduction", "efficiency")}
        shown["gaps"] = {}
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            shown["gaps"][width] = gaps(page)
        browser.close()
        return shown


if __name__ == "__main__":
    given = sys.argv[1:]
    if len(given) == 2:
        print(json.dumps(still(*given)))
        sys.exit()
    print(json.dumps(visit(given[0], given[1], Path(given[2]), float(given[3]) if len(given) > 3 else 1.0)))
