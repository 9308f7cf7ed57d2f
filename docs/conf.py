"""The documentation site: `make docs` builds it, without a network, into build/docs/html."""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

# scripts run beside each other, one for each core; threads that wait for each other would take the cores away
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
# joblib replaces a process that has become large, as compiled loops and PyTorch make it, and says so
warnings.filterwarnings("ignore", "A worker stopped while some jobs were given", UserWarning)
HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import nablahog  # noqa: E402  (after the path of our extensions)

sys.modules["nablahog.presets"] = nablahog.presets  # autodoc imports what a public name is in

project = "∇HOG"
author = "The nablahog authors"
project_copyright = author
version = release = nablahog.__version__
language = "en"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",  # reads "Args:" and "Attributes:", which numpydoc does not
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "citation",  # docs/_ext, as the next ones
    "command_line",
    "elsewhere",
    "public_names",
    "source_pages",
]
templates_path = ["_templates"]
GALLERIES = [name for name in ("gallery", "tutorials") if [*(HERE / name).glob("GALLERY_HEADER.*")]]
exclude_patterns = ["_ext", "_templates", "gallery", "tutorials", "**/README.*", "**/GALLERY_HEADER.*"]
nitpicky = True
smartquotes = False  # quotes of Python stay straight

# what the tables call the magnitude of a correlation; bars mean something else in reStructuredText
rst_prolog = r".. |CC| replace:: \|CC\|"

# ---- pages in Markdown
myst_enable_extensions = ["colon_fence", "deflist", "attrs_block"]
myst_heading_anchors = 4  # links such as security.md#caches
suppress_warnings = ["myst.header"]  # the notes of the changelog begin at the third level

# ---- docstrings
autosummary_generate = True
autosummary_ignore_module_all = False
autosummary_filename_map = {"nablahog.HOG": "nablahog.HOG-class"}  # some file systems take HOG for hog
autodoc_default_options = {"members": True, "show-inheritance": False}
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # attributes of dataclasses are described once, by "Attributes:"
napoleon_use_rtype = False
python_use_unqualified_type_names = True
maximum_signature_line_length = 88
# what other packages define has no page here, and a build asks no network
nitpick_ignore_regex = [
    (r"py:.*", r"(torch|numpy|np|npt|PIL|collections|pathlib|types|typing|abc|sklearn|os|io|dataclasses)\..*"),
    (r"py:.*", r"Tensor|NDArray|Image|Path|Callable|Sequence|Mapping|Iterable|Iterator|Collection|Any|Self"),
]

# ---- gallery and tutorials
sphinx_gallery_conf: dict[str, Any] = {
    "examples_dirs": GALLERIES,
    "gallery_dirs": [f"auto_{name}" for name in GALLERIES],
    "filename_pattern": r"plot_",
    "parallel": min(os.cpu_count() or 1, 4),
    "within_subsection_order": "FileNameSortKey",
    "doc_module": ("nablahog",),
    "backreferences_dir": "api/generated/backreferences",
    "abort_on_example_error": False,
    "only_warn_on_example_error": True,  # with -W it is an error all the same, but the others are built
    "matplotlib_animations": False,
    "remove_config_comments": True,
    "show_memory": False,
    "download_all_examples": False,
    "write_computation_times": False,  # that page loads scripts from elsewhere
}

# ---- what it looks like
html_theme = "pydata_sphinx_theme"
html_title = "∇HOG"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options: dict[str, Any] = {
    "logo": {"text": "∇HOG"},
    "navbar_align": "left",
    "header_links_before_dropdown": 7,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "navigation_with_keys": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_sidebars: dict[str, list[str]] = {"index": []}
copybutton_exclude = ".linenos, .gp, .go"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
