"""The site of this project: `python -m sphinx -W docs build/site`, without a network.

`-D plot_gallery=0` leaves the examples of the gallery unexecuted: a try in seconds. What the
project adds to Sphinx is in pages.py beside this file.
"""

import sys
import tomllib
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # pages.py
pyproject = Path(__file__).parents[1] / "pyproject.toml"

project = "structural-model-zoo"
release = tomllib.loads(pyproject.read_text("utf-8"))["project"]["version"]
root_doc = "README"  # its questions are the navigation
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "pages",
]

html_theme = "furo"
html_title = f"{project} {release}"
html_favicon = "figures/icon.svg"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"

myst_heading_anchors = 4  # as GitHub names them
myst_enable_extensions = ["html_image"]  # <img> of tables

autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_inherit_docstrings = False  # Lightning's are in another markup
autodoc_preserve_defaults = True
maximum_signature_line_length = 80
python_use_unqualified_type_names = True

sphinx_gallery_conf = {
    "examples_dirs": "../gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "show_memory": False,
    "write_computation_times": False,
    "show_signature": False,
    "remove_config_comments": True,
    "download_all_examples": False,
}
