"""Settings of Sphinx: `python -m sphinx docs docs/_build` (extra `docs`) builds the pages."""

import sys
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import api
import catalogue
from jinja2 import FileSystemLoader
from jinja2.sandbox import SandboxedEnvironment
from numpydoc import docscrape_sphinx

project = "hybridsurrogate"
author = "The hybridsurrogate founders"
copyright = "The hybridsurrogate founders"
version = release = installed("hybridsurrogate")
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "numpydoc",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]
templates_path = ["_templates"]
autosummary_generate = True
numpydoc_show_class_members = False
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence"]
# inventories of the names that pages link to lie here, so that no network is needed
intersphinx_mapping = {
    "scipy": ("https://docs.scipy.org/doc/scipy", "inventories/scipy.inv"),
    "sklearn": ("https://scikit-learn.org/stable", "inventories/sklearn.inv"),
}
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "filename_pattern": "/plot_",
    # pages import what they share from the folder `reproduction`; the rest are commands
    "ignore_pattern": r"(^|/)(?!plot_)[^/]*\.py$",
    "abort_on_example_error": True,
}
# numpydoc compiles its template anew for each of thousands of docstrings: here once
_templates = Path(docscrape_sphinx.__file__).parent / "templates"
_environment = SandboxedEnvironment(loader=FileSystemLoader(_templates))
docscrape_sphinx.SandboxedEnvironment = lambda loader: _environment
html_theme = "pydata_sphinx_theme"
html_title = "hybridsurrogate"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_theme_options = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc"],
}
html_show_sourcelink = False
# prompts are not copied
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True


def fill_in(app, docname, source):
    """Put the catalogue of causes into the page that asks for it."""
    if docname == "reference/causes":
        pictures = catalogue.write_pictures(Path(app.srcdir) / "reference" / "pictures")
        text = catalogue.catalogue(pictures, "pictures")
        source[0] = source[0].replace("{{ catalogue of causes }}", text)


def setup(app):
    """Write the page of names, and have the catalogue filled in."""
    # autosummary looks for names in files, so the page must lie there before it looks
    page = Path(app.srcdir) / "reference" / "api.rst"
    page.write_text(api.page_of_names(), encoding="utf-8")
    app.connect("source-read", fill_in)
