# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings of Sphinx for the site: `make docs` builds it into out/docs/VERSION (docs/decisions/0065-the-site.md)."""

import os
import sys
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(_ROOT), str(_ROOT / "docs" / "_site")]

project = "ATPID"
author = "ATPID contributors"
copyright = "2026 ATPID maintainers, Apache License 2.0"
version = release = os.environ.get("ATPID_DOCS_VERSION", "development")

extensions = ["myst_parser", "sphinx.ext.autodoc", "reference"]
# The sources are the repository's own pages, where they lie: their links hold on a code-hosting site and here.
root_doc = "README"
include_patterns = [
    "README.md", "CONTRIBUTING.md", "bags/README.md", "docs/**.md",
    *(f"{package}/{name}" for package in ("atpid_*", "atpid_interfaces/*", "extensions/*")
      for name in ("README.md", "QUALITY_DECLARATION.md", "CHANGELOG.rst")),
]  # fmt: skip
exclude_patterns = [".*", "out", "ros2_ws", "tests", "studies", "scenes", "**/test", "**/__pycache__"]
myst_enable_extensions = ["deflist"]
myst_heading_anchors = 6

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
add_module_names = False
nitpicky = True
# Types of libraries and of parts that have no page: names without a link.
nitpick_ignore_regex = [("py:.*", ".*")]

smartquotes = False  # of options, "--steady"

html_theme = "furo"
html_title = "ATPID"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_search_scorer = str(_ROOT / "docs/_site/scorer.js")  # pages of docs/research and docs/decisions come last
templates_path = ["_site/templates"]
html_sidebars = {
    "**": [
        "sidebar/brand.html", "versions.html", "sidebar/search.html", "sidebar/scroll-start.html",
        "sidebar/navigation.html", "sidebar/scroll-end.html",
    ]
}  # fmt: skip
html_copy_source = False
html_show_sourcelink = False
