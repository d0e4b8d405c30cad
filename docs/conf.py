"""How Sphinx makes the site: `make docs`, and the result is `docs/_build/html/index.html`."""

from __future__ import annotations

import os
import re

from sphinx.application import Sphinx

from simulator import __version__

project = "dielectric-balloons"
author = "the dielectric-balloons developers"
version = release = __version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_copybutton",
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "figures", "gallery"]
nitpicky = True

# Pages are written for GitHub as well: its formulas, its anchors, links with .md.
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4

# The docstrings say what is expected and returned. They are checked by mypy and `make check`.
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
autosummary_generate = True
numpydoc_show_class_members = False
default_role = "autolink"

# Other projects' lists of names are read where the site is hosted. Elsewhere there may be no network, and a
# build must not depend on it.
intersphinx_mapping = (
    {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
        "pandas": ("https://pandas.pydata.org/docs", None),
        "matplotlib": ("https://matplotlib.org/stable", None),
        "xarray": ("https://docs.xarray.dev/en/stable", None),
    }
    if os.environ.get("READTHEDOCS")
    else {}
)

html_theme = "pydata_sphinx_theme"
html_title = f"dielectric-balloons {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "navigation_with_keys": True,
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "footer_end": [],
}

# Prompts are shown, and not copied.
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

# Pages beside `docs/`, and what they are called on the site. Links between them and the others are put right.
_BESIDE = {"CONTRIBUTING.md": "contributing", "CHANGELOG.md": "changelog"}


def _read(app: Sphinx, docname: str, content: list[str]) -> None:
    """What Sphinx reads in place of a page's own text."""
    text, up = content[0], "../" * docname.count("/")
    for file, page in _BESIDE.items():
        if docname == page:
            written = (app.srcdir.parent / file).read_text("utf-8")
            text = re.sub(r"\]\((?!https?:|#)", "](../", written).replace("](../docs/", "](")
    for file, page in _BESIDE.items():
        text = text.replace(f"]({up}../{file}", f"]({up}{page}.md")
    content[0] = text


def setup(app: Sphinx) -> None:
    """What Sphinx calls first."""
    app.connect("source-read", _read)
