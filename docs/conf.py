"""How Sphinx makes the site: `make docs`, and the result is `docs/_build/html/index.html`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html import unescape
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.config import Config

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
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",  # formulas without a network: the site can be read from disk
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_made", "figures", "gallery/scripts.md", "**/GALLERY_HEADER.rst"]
nitpicky = True

# Pages are written for GitHub as well: its formulas, its anchors, links with .md.
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4

# The docstrings say what is expected and returned. They are checked by mypy and `make check`.
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
autosummary_generate = True
toc_object_entries_show_parents = "hide"
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

# Every script is run, and its picture is what it draws: a script that fails fails the build.
sphinx_gallery_conf = {
    "examples_dirs": ["gallery"],
    "gallery_dirs": ["gallery/drawn"],
    "filename_pattern": "/",
    "subsection_order": [f"gallery/{name}" for name in ("snaps", "gas", "films", "hysteresis", "many")],
    "within_subsection_order": "FileNameSortKey",
    "capture_repr": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "min_reported_time": 60,
    "write_computation_times": False,
    "show_memory": False,
    "show_signature": False,
    "copyfile_regex": r"^$",
    "remove_config_comments": True,
    "image_srcset": ["2x"],
}

html_theme = "pydata_sphinx_theme"
html_title = f"dielectric-balloons {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_sidebars = {page: [] for page in ("index", "faq", "contributing", "changelog")}
html_extra_path = ["_made/files"]
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
    # The gallery of the site has the pictures; on GitHub a list of the scripts stands in for it.
    content[0] = text.replace("](gallery/scripts.md)", "](gallery/drawn/index.rst)")


def _make(app: Sphinx, config: Config) -> None:
    """What is made from the program itself: the options of its commands, and the schema of scenarios."""
    commands = unescape(_printed("typer", "simulator.cli", "utils", "docs", "--name", "balloons"))
    sections = commands[commands.index("## `") :].replace("```console", "```sh")
    _write(app.srcdir / "_made" / "commands.md", sections)
    _write(app.srcdir / "_made" / "files" / "scenario.schema.json", _printed("simulator", "schema"))


def _printed(module: str, *arguments: str) -> str:
    """What a module prints that is run as a program."""
    command = [sys.executable, "-m", module, *arguments]
    return subprocess.run(command, capture_output=True, encoding="utf-8", check=True).stdout


def _write(file: Path, text: str) -> None:
    """Write a file where its text has changed, so that an unchanged page is not built again."""
    file.parent.mkdir(parents=True, exist_ok=True)
    if not file.exists() or file.read_text("utf-8") != text:
        file.write_text(text, "utf-8")


def setup(app: Sphinx) -> None:
    """What Sphinx calls first."""
    app.connect("config-inited", _make, priority=100)
    app.connect("source-read", _read)
