# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Opens the site with Chromium from its files and prints what was seen, as JSON: a program, so that no browser is left.

python tests/site_visit.py CHROMIUM SITE WORD...; each word is looked for with the site's own search.
"""

import json
import sys
from pathlib import Path

from page_visit import SCREENS, browsing, wrong

PAGES = ("README", "docs/commands", "docs/messages", "docs/parameters")


def main(chromium: str, site: str, *words: str) -> None:
    """Print the pages found for each word, and what is wrong with pages: a rule of axe, or wider than the screen."""
    found, bad = {}, {}
    root = Path(site).resolve()
    with browsing(chromium) as browser:
        for word in words:
            page = browser.open(f"{(root / 'search.html').as_uri()}?q={word}")
            page.wait_for_selector("#search-results .search-summary:has-text('found')")
            found[word] = page.eval_on_selector_all("#search-results li a", "all => all.map((each) => each.href)")
            page.close()
        for name in PAGES:
            for screen, (size, schemes) in SCREENS.items():
                page = browser.open((root / f"{name}.html").as_uri(), viewport=size, color_scheme=schemes[0])
                for scheme in schemes:
                    page.emulate_media(color_scheme=scheme)
                    wide = page.evaluate("document.documentElement.scrollWidth") > size["width"]
                    bad[f"{name} {screen} {scheme}"] = ["wide"] * wide + (wrong(page) if screen == "desktop" else [])
                page.close()
    print(json.dumps({"found": found, "wrong": {where: what for where, what in bad.items() if what}}))


if __name__ == "__main__":
    main(*sys.argv[1:])
