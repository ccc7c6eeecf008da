"""Settings of Sphinx: `python -m sphinx docs docs/_build` (extra `docs`) builds the pages."""

from importlib.metadata import version as installed

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


def _fill_in(app, docname, source):
    # what registers itself is listed by itself
    source[0] = source[0].replace("{{ table of causes }}", table_of_causes())


def setup(app):
    """Connect what is filled in."""
    app.connect("source-read", _fill_in)
