"""The documentation as a site: ``make site`` makes ``out/site`` of the Markdown files, as they are, and of docstrings.

The source folder is the repository, so that a link leads to the same page here and where the repository is read. What
Sphinx needs besides is added while it reads: the order of the pages in the side bar, and a page for each public room
under ``docs/api``, which git ignores.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

import onlinebayes

sys.path.insert(0, str(Path(__file__).parent))

import api
import docstrings

ROOT = Path(__file__).parents[2]

project = "onlinebayes"
version = release = onlinebayes.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "docs/README"
include_patterns = ["*.md", "docs/**", "envs/**/*.md"]
exclude_patterns = [".*", "out", "build", "onlinebayes", "recipes", "tests"]
suppress_warnings = [
    "myst.header",  # a list of short entries goes from level 1 to level 3
    "ref.python",  # the name of an attribute that several classes have
]

myst_heading_anchors = 6
nb_execution_mode = "force"
nb_execution_timeout = 120
nb_execution_raise_on_error = True
nb_merge_streams = True

add_module_names = False
toc_object_entries = False  # the side bar is made anew for every page, and would be copied with all of them
napoleon_numpy_docstring = False
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"onlinebayes {release}"
html_static_path = ["static"]
html_css_files = ["wide.css"]
html_copy_source = False
html_show_copyright = False
highlight_language = "none"

SIDE_BAR = {
    "docs/README": {
        "Use": ["/README", "/docs/tutorial", "/docs/problem-files", "/docs/shown", "/docs/glossary", "/docs/limits"],
        "Examples": ["/docs/examples/*"],
        "How it works": ["/docs/concepts/*"],
        "Reference": [
            "/docs/effects/README",
            "/docs/api",
            "/docs/versions",
            "/docs/architecture",
            "/docs/decisions/README",
        ],
        "Evidence": ["/docs/results/README", "/docs/thesis", "/docs/peers", "/docs/log", "/envs/measured/README"],
        "Project": ["/CHANGELOG", "/CONTRIBUTING", "/SECURITY", "/AGENTS"],
    },
    "docs/effects/README": {"Effects": ["/docs/effects/*"]},
    "docs/api": {"Rooms": ["/docs/api/*"]},
}
"""Page -> caption -> the pages below it in the side bar; a page in none of them is a warning, and so an error."""

BESIDE = re.compile(r"docs/(decisions|results)/(?!README)|envs/measured/.+/")
"""Pages that are reached from the table of their README alone: a side bar with all of them would be no help."""

SHOWN = """
## Here

<p><a href="../shown/report/report.html">The report</a>, its <a href="../shown/report/run.rrd">recording</a> and the
<a href="../shown/report/refined.xml">refined model</a>. <a href="../shown/run/run.html">The run's page</a> and its
<a href="../shown/run/run.rrd">recording</a>, for <a href="https://rerun.io">Rerun</a>. Stills of the recording: an
episode of the run, and pale, the same episode in the model of the belief:</p>

<p><img src="../shown/stills.png" alt="Stills of an episode"></p>
"""
"""Links to what ``shown.py`` made; they lead somewhere on the site alone."""


def toctree(caption: str, pages: list[str]) -> str:
    """The directive that puts pages into the side bar."""
    return "\n".join(["", "```{toctree}", ":hidden:", ":glob:", f":caption: {caption}", "", *pages, "```", ""])


def read(app: Sphinx, name: str, source: list[str]) -> None:
    """Give a page its part of the side bar; links to folders lead to their README, or nowhere where they have none."""
    folder = (ROOT / name).parent

    def of_folder(link: re.Match[str]) -> str:
        if "://" in link["to"] or not (folder / link["to"]).is_dir():
            return link[0]
        page = folder / link["to"] / "README.md"
        return f"[{link['text']}]({link['to'].rstrip('/')}/README.md)" if page.exists() else link["text"]

    text = re.sub(r"\[(?P<text>[^\]]*)\]\((?P<to>[^)#\s]+)\)", of_folder, source[0])
    before = "---\norphan: true\n---\n" if BESIDE.match(name) else ""
    after = SHOWN if name == "docs/shown" else ""
    trees = "".join(toctree(caption, pages) for caption, pages in SIDE_BAR.get(name, {}).items())
    source[0] = before + text + after + trees


def write_api(app: Sphinx) -> None:
    """Write the pages of the rooms."""
    api.write(ROOT / "docs" / "api")


def write_first_page(app: Sphinx, failed: Exception | None) -> None:
    """Write the page at the site's root, which leads to the first one."""
    if failed is None:
        lead = f'<meta http-equiv="refresh" content="0; url={root_doc}.html"><a href="{root_doc}.html">{project}</a>'
        page = f"<!doctype html><title>{project}</title>{lead}\n"
        (Path(app.outdir) / "index.html").write_text(page, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("builder-inited", write_api)
    app.connect("source-read", read)
    app.connect("autodoc-process-docstring", docstrings.as_sphinx_reads_them, priority=400)  # before napoleon
    app.connect("build-finished", write_first_page)
