# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Opens the site with Chromium from its files and prints what was seen, as JSON: a program, so that no browser is left.

python tests/site_visit.py CHROMIUM SITE WORD...; each word is looked for with the site's own search.
"""

import json
import sys
from pathlib import Path
from typing import Any

from page_visit import SCHEMES, SCREENS, errors_of, new_page

PAGES = ("README", "docs/commands", "docs/messages", "docs/parameters")


def main(chromium: str, site: str, *words: str) -> None:
    """Print the pages found for each word, and what is wrong with pages: errors, or a page wider than the screen."""
    from axe_playwright_python.sync_playwright import Axe
    from playwright.sync_api import sync_playwright

    found: dict[str, list[str]] = {}
    wrong: dict[str, list[str]] = {}
    root = Path(site).resolve()
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page: Any = new_page(browser)
        for word in words:
            page.goto(f"{(root / 'search.html').as_uri()}?q={word}")
            page.wait_for_selector("#search-results .search-summary:has-text('found')")
            found[word] = page.eval_on_selector_all("#search-results li a", "all => all.map((each) => each.href)")
        page.close()
        for name in PAGES:
            for screen, size in SCREENS.items():
                page = new_page(browser, viewport=size)
                errors = errors_of(page)
                for place, scheme in enumerate(SCHEMES[screen]):
                    page.emulate_media(color_scheme=scheme)
                    if place == 0:
                        page.goto((root / f"{name}.html").as_uri())
                    if page.evaluate("document.documentElement.scrollWidth") > size["width"]:
                        errors.append("scrolls sideways")
                    if screen == "desktop":
                        errors += [one["id"] for one in Axe().run(page).response["violations"]]
                    if errors:
                        wrong[f"{name} {screen} {scheme}"] = [*errors]
                page.close()
        browser.close()
    print(json.dumps({"found": found, "wrong": wrong}))


if __name__ == "__main__":
    main(*sys.argv[1:])
