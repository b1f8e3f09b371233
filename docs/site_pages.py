"""A hook of MkDocs: pages and pictures of the site that stand outside `docs/`, and links as the site needs them.

On the site, files named here have the name beside them; links between files of the repository follow.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
OUTSIDE = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "CITATION.cff": "CITATION.cff",
    "recordings/README.md": "recordings.md",
} | {
    f"recordings/{picture.name}": f"recordings/{picture.name}"
    for picture in (ROOT / "recordings").glob("*.[pg][ni][gf]")
}
"""File of the repository: its name on the site."""
SOURCES = {name: source for source, name in OUTSIDE.items()}
LINK = re.compile(r"(?<=\]\()(?!\w+://)([^)#\s]+)")
FENCE = re.compile(r"^```(\w+) ([\w.]+)$", flags=re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the files from outside."""
    for source, name in OUTSIDE.items():
        files.append(File.generated(config, name, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links name the site's files; a file's name in a fence becomes its title."""
    name = page.file.src_uri
    folder = PurePosixPath(SOURCES.get(name, f"docs/{name}")).parent

    def on_site(link: re.Match[str]) -> str:
        target = normpath(str(folder / link[0]))
        return relpath(OUTSIDE.get(target, target.removeprefix("docs/")), PurePosixPath(name).parent)

    titled = FENCE.sub(
        lambda fence: f'```{fence[1]} title="{fence[2]}"' if "." in fence[2] else f"```{fence[1]}", markdown
    )
    return LINK.sub(on_site, titled)
