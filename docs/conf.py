"""Settings of the documentation: ``python -m sphinx -W docs docs/_build`` builds it."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "femfit"
author = "The femfit developers"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "mathml",  # the two of _ext
    "pages",
]
exclude_patterns = ["_build", "_ext", "generated/columns.md"]  # the last is included by a page
templates_path: list[str] = []

# Pages
myst_enable_extensions = ["dollarmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
highlight_language = "none"  # a block without a language is what a command prints
nb_execution_mode = "off"  # the notebooks of tutorial/ hold their results: see _ext/run_notebooks.py
nb_merge_streams = True

# The library
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_use_ivar = True

# The site works without a network and opened from disk: no fonts, scripts or mathematics from elsewhere
html_theme = "pydata_sphinx_theme"
html_title = "femfit"
html_static_path = ["_static"]
html_css_files = ["femfit.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_copy_source = False
html_sidebars = {"index": [], "glossary": []}
html_theme_options = {
    "show_nav_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": True,
    "pygments_light_style": "tango",
    "navbar_end": ["theme-switcher"],
}
copyright = "The femfit developers, MIT licence"  # noqa: A001  Sphinx's name
