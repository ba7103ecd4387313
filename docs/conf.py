"""
Sphinx settings of the documentation, which `make html` builds into build/html and rosdoc2 for docs.ros.org.

The source folder of both is the parent of this folder. README.md, CONTRIBUTING.md and CHANGELOG.rst are pages next to
docs/, and relative links work on GitHub, in build/html and on docs.ros.org. rosdoc2 executes this file inside its own
configuration, in which ``rosdoc2_settings`` is defined, and chooses the landing page and the theme.
"""

import importlib.util
import re
from pathlib import Path

RUN_BY_ROSDOC2 = 'rosdoc2_settings' in globals()
# rosdoc2 executes this file from its parent folder.
ROOT = Path(__file__).resolve().parent.parent if not RUN_BY_ROSDOC2 else Path(__file__).resolve().parent
DOCS = ROOT / 'docs'

project = 'hdd_servo_ros'
author = 'hdd_servo_ros maintainers'
copyright = author  # noqa: A001 (Sphinx's name)

# rosdoc2 removes all other extensions.
extensions = [
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
    'sphinx.ext.mathjax',
    'myst_parser',
]

# Anchors of headings as on GitHub, and equations between dollar signs.
myst_heading_anchors = 4
myst_enable_extensions = ['dollarmath', 'amsmath']

# With the default, the attributes of a dataclass are documented twice.
napoleon_use_ivar = True
napoleon_google_docstring = False
# Names of returned values are not types.
napoleon_use_rtype = False
autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_preserve_defaults = True
autodoc_class_signature = 'mixed'
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = 'hide'
# Not a dependency in package.xml, since it has no rosdep key.
autodoc_mock_imports = [] if importlib.util.find_spec('plotly') else ['plotly']

if not RUN_BY_ROSDOC2:
    version = release = re.search(
        r"__version__ = '(.+)'", (ROOT / 'hdd_servo_ros' / 'version.py').read_text('utf8')
    ).group(1)
    root_doc = 'docs/index'
    include_patterns = ['README.md', 'CONTRIBUTING.md', 'CHANGELOG.rst', 'docs/**']
    # build/html/index.html, which redirects to docs/index.html.
    html_extra_path = [str(DOCS / '_root')]
    # A light and a dark mode, and system fonts. sphinx_rtd_theme, which rosdoc2 uses for all ROS packages, has no dark
    # mode.
    html_theme = 'furo'
    html_title = f'hdd_servo_ros {version}'
    html_static_path = [str(DOCS / '_static')]
    html_css_files = ['site.css']
    html_copy_source = False
    html_show_sphinx = False

    # MathJax in one file, with SVG output: it loads neither fonts nor files from the network.
    _mathjax = importlib.util.find_spec('sphinx-mathjax-offline')
    if _mathjax is None or _mathjax.origin is None:
        raise ModuleNotFoundError('sphinx-mathjax-offline is not installed: pip install -e .[docs]')
    html_static_path.append(str(Path(_mathjax.origin).parent / 'static' / 'mathjax' / 'tex-svg.js'))
    mathjax_path = 'tex-svg.js'
