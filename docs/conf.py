"""Settings of Sphinx: `python -m sphinx docs docs/_build` (extra `docs`) builds the pages."""

from importlib.metadata import version as installed
from pathlib import Path

import hybridsurrogate as hs
from hybridsurrogate.effects.registry import table_of_causes

project = "hybridsurrogate"
author = "The hybridsurrogate founders"
version = release = installed("hybridsurrogate")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
]
root_doc = "contents"
exclude_patterns = ["_build"]
autosummary_generate = True
numpydoc_show_class_members = False
myst_heading_anchors = 3
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "filename_pattern": "/plot_",
    # pages import what they share from the folder `reproduction`; the rest are commands
    "ignore_pattern": r"(^|/)(?!plot_)[^/]*\.py$",
    "abort_on_example_error": True,
}


def page_of_names():
    """Return the page of all public names."""
    head = ["API", "===", "", ".. currentmodule:: hybridsurrogate", ""]
    head += [".. autosummary::", "   :toctree: generated", ""]
    return "\n".join([*head, *(f"   {name}" for name in sorted(hs.__all__)), ""])


def fill_in(app, docname, source):
    """Put the table of causes into a page that Sphinx has read."""
    source[0] = source[0].replace("{{ table of causes }}", table_of_causes())


def setup(app):
    """Write the page of names, and have the table filled in."""
    # autosummary looks for names in files, so the page must lie there before it looks
    (Path(app.srcdir) / "api.rst").write_text(page_of_names(), encoding="utf-8")
    app.connect("source-read", fill_in)
