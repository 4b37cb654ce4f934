"""Sphinx configuration of the documentation site: ``python -m sphinx -W --keep-going docs OUT``.

The pages are those that GitHub shows. Pages of the repository root and the reference are generated into ``project/``
and ``reference/`` before Sphinx looks for pages. The site loads nothing from other hosts: ``docs/check_site.py``.
"""

import importlib.util
import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path[:0] = [str(DOCS), str(DOCS.parent)]

import jaxtyping  # noqa: E402, F401  imported first, so that signatures have the shapes of arrays

from rnc_pin.version import __version__  # noqa: E402

project = "rnc_pin"
author = "The rnc_pin authors"
copyright = "The rnc_pin authors, BSD-3-Clause"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "generated",
    "site_pages",
    "site_scenes",
]
exclude_patterns = ["_scenes"]

html_theme = "furo"
toc_object_entries = False  # a page of the reference has a table of its names; a thousand entries would double the time
html_title = f"rnc_pin {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_search_scorer = str(DOCS / "project" / "search_scorer.js")  # site_pages writes it

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4

autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autosummary_generate = False
napoleon_numpy_docstring = False
napoleon_use_param = False  # an entry may name several: "n, r, p: degrees of freedom, ..."
napoleon_custom_sections = [("Attributes", "params_style")]
python_maximum_signature_line_length = 100
maximum_signature_line_length = 100

_MATHJAX = importlib.util.find_spec("sphinx-mathjax-offline")
if _MATHJAX is None or _MATHJAX.origin is None:
    raise ImportError("the site needs sphinx-mathjax-offline: pip install '.[docs]'")
mathjax_folder = Path(_MATHJAX.origin).parent / "static" / "mathjax"
mathjax_path = "mathjax/tex-svg.js"  # the one file needs no fonts

linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_ignore = [r"http://127\.0\.0\.1.*", r"http://localhost.*"]
