"""Sphinx's settings: `sphinx-build -W docs OUT` makes the documentation, without a network."""

import os
import sys
from datetime import date
from pathlib import Path
from typing import Any

import tex_lightning as tl

sys.path.insert(0, str(Path(__file__).parent))
import house
import key_reference

project = "tex_lightning"
author = "the developers of tex_lightning"
project_copyright = f"{date.today():%Y}, {author}"
release = tl.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.intersphinx"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 4  # links between chapters name headings
exclude_patterns = ["notebooks"]  # they are run as they are, and linked
html_theme = "furo"
html_title = "tex_lightning"
html_static_path = ["_static"]
html_css_files = ["site.css"]

autodoc_typehints = "description"
autodoc_member_order = "bysource"

# An inventory that cannot be fetched is a warning, and warnings are errors: links into other
# projects only where a network is promised.
intersphinx_mapping = (
    {
        "python": ("https://docs.python.org/3", None),
        "torch": ("https://docs.pytorch.org/docs/stable", None),
        "numpy": ("https://numpy.org/doc/stable", None),
    }
    if os.environ.get("DOCS_ONLINE")
    else {}
)

MADE = {"keys": key_reference.reference, "house": house.house}  # at build time, by marker


def fill_markers(_app: object, _page: str, source: list[str]) -> None:
    """Replace the markers of a page by what is made from the code."""
    for name, make in MADE.items():
        marker = f"<!-- made at build: {name} -->"
        if marker in source[0]:
            source[0] = source[0].replace(marker, make())


def setup(app: Any) -> None:  # noqa: ANN401
    """Register the markers with Sphinx."""
    app.connect("source-read", fill_markers)
