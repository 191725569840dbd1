"""Settings of the documents: every figure and table in them is made while they are built."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
# The helpers of this folder, and the benchmarks, which draw their own curves.
sys.path[:0] = [str(HERE), str(ROOT)]

import inscrutable

project = "inscrutable"
copyright = "the authors of inscrutable"
version = release = inscrutable.__version__

extensions = [
    "made_pages",
    "docstrings",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "myst_parser",
]
exclude_patterns = [
    "images",
    "concepts",
    "made/benchmarks/*.md",
    "made/claims/*.rst",
    "made/studies/*.rst",
]

html_theme = "furo"
html_title = f"inscrutable {release}"
html_static_path = ["static"]
html_css_files = ["tables.css"]
html_show_copyright = False
html_show_sourcelink = False

# Docstrings write `code` between single marks.
default_role = "code"
autodoc_default_options = {
    "members": True,
    "inherited-members": "Enum,Exception,tuple",
}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
# There are none, and every source would be parsed for them.
autodoc_use_type_comments = False
autodoc_type_aliases = {"ArrayLike": "ArrayLike", "Array": "Array"}
maximum_signature_line_length = 88
autosummary_generate = False
python_use_unqualified_type_names = True
add_module_names = False
napoleon_numpy_docstring = False

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3

sphinx_gallery_conf = {
    "examples_dirs": ["concepts", "../examples"],
    "gallery_dirs": ["made/concepts", "made/examples"],
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": ("made_pages.pictures",),
    "reset_modules": ("made_pages.strict",),
    "reset_modules_order": "both",
    "run_stale_examples": True,  # what a page shows is what the code does today
    "abort_on_example_error": False,
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "write_computation_times": False,
    "min_reported_time": 3600,
    "remove_config_comments": True,
    "doc_module": ("inscrutable",),
    "plot_gallery": True,
}
