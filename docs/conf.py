# SPDX-License-Identifier: MIT
"""Sphinx's settings for `make docs`: Markdown pages, and the reference from docstrings.

Formulas become MathML, which browsers draw by themselves: no script, no network.
"""

import re
from html import escape
from pathlib import Path

from docutils.nodes import SkipNode
from docutils.utils.math.latex2mathml import tex2mathml

root = Path(__file__).resolve().parent.parent

project = "dolfinx_contact"
author = copyright = "the dolfinx_contact authors"
release = version = re.search(
    r'__version__ = "(.*)"', (root / "dolfinx_contact" / "__init__.py").read_text()
).group(1)

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_rtd_theme"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # `failures.md#…` leads to a heading, as on a forge
html_theme = "sphinx_rtd_theme"
html_theme_options = {"navigation_depth": 2}
html_show_sourcelink = False
pygments_style = "sphinx"
root_doc = "index"
exclude_patterns = ["_build"]
nitpicky = False

# -- the reference ----------------------------------------------------------------------------

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # arguments are described in words, with shapes and units
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_attr_annotations = False


def verbatim(app, what, name, obj, options, lines):
    """Docstrings are text: |x|, *s and word_ in them mean nothing to reStructuredText."""
    for i, line in enumerate(lines):
        line = re.sub(r"(?<![`\\])(\||\*(?=\w))", r"\\\1", line)
        line = re.sub(r"(?<=\w)_(?=[\s,.;:)]|$)", r"\\_", line)
        lines[i] = line


# -- formulas ---------------------------------------------------------------------------------


def inline_math(writer, node):
    """A formula in a line."""
    writer.body.append(_mathml(node.astext()))
    raise SkipNode


def block_math(writer, node):
    """A formula of its own."""
    math = _mathml(node.astext()).replace("<math ", '<math display="block" ', 1)
    writer.body.append(f'<div class="math" title="{escape(node.astext())}">{math}</div>\n')
    raise SkipNode


def _mathml(latex):
    return tex2mathml(latex).replace("\n", "")


def setup(app):
    app.connect("autodoc-process-docstring", verbatim)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))


html_math_renderer = "mathml"
