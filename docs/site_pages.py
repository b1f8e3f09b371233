"""A hook of MkDocs: pages and pictures from outside `docs/`, notebooks as pages, and links as the site needs them.

On the site, files named here have the name beside them; links between files of the repository follow.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from posixpath import normpath, relpath
from typing import Any

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
LINK = re.compile(r"(?<=\]\()(?!\w+:)([^)#\s]+)")
FENCE = re.compile(r"^```(\w+) ([\w.]+)$", flags=re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the files from outside."""
    for source, name in OUTSIDE.items():
        files.append(File.generated(config, name, abs_src_path=str(ROOT / source)))
    for notebook in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        cells = json.loads(notebook.read_text())["cells"]
        text = "\n\n".join(part for cell in cells for part in _shown(cell))
        files.append(File.generated(config, f"notebooks/{notebook.stem}.md", content=text))
    return files


def _shown(cell: dict[str, Any]) -> Iterator[str]:
    """A notebook's cell in Markdown: its text, or its code, what that prints, and its pictures."""
    source = "".join(cell["source"])
    yield f"```python\n{source}\n```" if cell["cell_type"] == "code" else source
    for output in cell.get("outputs", ()):
        data = output.get("data", {})
        printed = "".join(output.get("text", data.get("text/plain", "")))
        if "image/png" in data:
            yield f"![What the cell draws](data:image/png;base64,{''.join(data['image/png']).strip()})"
        elif printed:
            yield f"```text\n{printed.rstrip()}\n```"


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links name the site's files; a file's name in a fence becomes its title."""
    name = page.file.src_uri
    folder = PurePosixPath(SOURCES.get(name, f"docs/{name}")).parent

    def on_site(link: re.Match[str]) -> str:
        target = normpath(str(folder / link[0]))
        target = OUTSIDE.get(target, target.removeprefix("docs/").replace(".ipynb", ".md"))
        return relpath(target, PurePosixPath(name).parent)

    titled = FENCE.sub(
        lambda fence: f'```{fence[1]} title="{fence[2]}"' if "." in fence[2] else f"```{fence[1]}", markdown
    )
    return LINK.sub(on_site, titled)
