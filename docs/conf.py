"""Settings of the documentation site: ``make docs`` builds it from the repository's pages.

The root of the repository is the source, so that links between pages work as they do in a checkout.
"""

import sys
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert

sys.path.insert(0, str(Path(__file__).parent))

import site_reference

import flighttune

project = "flighttune"
author = "the flighttune developers"
release = version = flighttune.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc"]
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "docs/api/*.md",
    "design/*.md",
    "scenarios/README.md",
    "scenarios/*/README.md",
    "aircraft/*/README.md",
    "*.md",
]
exclude_patterns = [".*", "flighttune", "tests", "runs", "build", "dist", "benchmarks"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = "flighttune"
html_show_sourcelink = False
html_show_copyright = False
html_copy_source = False
html_search_scorer = str(Path(__file__).with_name("search.js"))  # Sphinx opens it as it stands
html_math_renderer = "mathml"
html_static_path = ["math.css"]
html_css_files = ["math.css"]
numpydoc_show_class_members = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
toc_object_entries_show_parents = "hide"


def _math(display):
    """Equations as MathML: the site needs neither a network nor a script to show them."""

    def visit(translator, node):
        markup = convert(node.astext(), display=display)
        # the bar of a norm that carries an index would be stretched below the line
        translator.body.append(markup.replace("<mo>&#x02016;", '<mo stretchy="false">&#x02016;'))
        raise nodes.SkipNode

    return visit, None


def setup(app):
    app.add_html_math_renderer("mathml", _math("inline"), _math("block"))
    app.connect("html-page-context", site_reference.load_pages)
    app.connect("build-finished", site_reference.pages_to_search)
    app.connect("source-read", site_reference.complete)
    app.connect("autodoc-process-docstring", site_reference.index_entry, priority=900)
