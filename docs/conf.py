"""The site: ``pip install '.[docs]' && sphinx-build -W -b html docs build/site``."""

from __future__ import annotations

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "site")]

from made import filled  # noqa: E402

from clsim.version import VERSION  # noqa: E402

project = "clsim"
author = "The clsim developers"
version = release = VERSION
html_title = f"clsim {VERSION}"
copyright = "The clsim developers, Apache License 2.0"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_copybutton"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
exclude_patterns = ["images", "site"]
default_role = "code"
smartquotes = False  # two dashes are an option

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_mock_imports = ["torch"]
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_static_path = ["site/static"]
html_css_files = ["clsim.css"]
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}

OUTSIDE = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md", "LICENSE": "license.md"}
"""Files of the root that are pages here too."""


def _made(app: object, docname: str, source: list[str]) -> None:
    """Fill what is made from the code, and lead links to files of the root to their pages."""
    text = filled(source[0])
    for name, page in OUTSIDE.items():
        text = re.sub(rf"\]\((\.\./)+{re.escape(name)}", f"]({'../' * docname.count('/')}{page}", text)
    source[0] = text


def _included(app: object, path: Path, parent: str, source: list[str]) -> None:
    """Lead links of an included file of the root to where they lead from here."""
    source[0] = re.sub(r"\]\(docs/", "](", source[0])
    for name, page in OUTSIDE.items():
        source[0] = source[0].replace(f"]({name})", f"]({page})")


def setup(app: object) -> None:
    """Connect what Sphinx calls."""
    app.connect("source-read", _made)  # type: ignore[attr-defined]
    app.connect("include-read", _included)  # type: ignore[attr-defined]
