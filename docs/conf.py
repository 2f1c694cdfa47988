# SPDX-License-Identifier: MIT
"""Sphinx's settings for `make docs`: Markdown pages, and the reference from docstrings.

Formulas are drawn by Debian's MathJax, of which the pages get a copy: no network is needed.
"""

import re
import shutil
import sys
from pathlib import Path

root = Path(__file__).resolve().parent.parent
# the installed package: the source directory has no extension module
sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != root]

project = "dolfinx_contact"
author = copyright = "the dolfinx_contact authors"
release = version = re.search(
    r'__version__ = "(.*)"', (root / "dolfinx_contact" / "__init__.py").read_text()
).group(1)

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_rtd_theme",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # `failures.md#…` leads to a heading, as on a forge
html_theme = "sphinx_rtd_theme"
html_theme_options = {"navigation_depth": 2}
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
pygments_style = "sphinx"
root_doc = "index"

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
        # "Attributes: u, comm: …" would be taken as a type and a name
        lines[i] = re.sub(r"^:ivar ([^:]*):", lambda m: m[0].replace(", ", ","), line)


# -- formulas ---------------------------------------------------------------------------------

mathjax = Path("/usr/share/javascript/mathjax")
mathjax_path = "mathjax/MathJax.js?config=TeX-AMS_SVG"
mathjax2_config = {"tex2jax": {"processClass": "math", "ignoreClass": "document"}}
myst_update_mathjax = False


def copy_mathjax(app, error):
    """What TeX to SVG needs of it, with one font."""
    if error is not None or app.builder.format != "html":
        return
    for part in (
        "MathJax.js",
        "config/TeX-AMS_SVG.js",
        "extensions",
        "jax/element",
        "jax/output/SVG",
    ):
        to = Path(app.outdir) / "_static" / "mathjax" / part
        to.parent.mkdir(parents=True, exist_ok=True)
        if (mathjax / part).is_dir():
            others = shutil.ignore_patterns("Asana*", "Gyre*", "Latin*", "Neo*", "STIX*")
            shutil.copytree(mathjax / part, to, ignore=others, dirs_exist_ok=True)
        else:
            shutil.copyfile(mathjax / part, to)


def setup(app):
    app.connect("autodoc-process-docstring", verbatim)
    app.connect("build-finished", copy_mathjax)
