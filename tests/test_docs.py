"""What the pages of `docs/` say works, word for word, in their order; on cut-down logs of the recordings' names."""

import json
import os
import re
import shlex
import sys
from contextlib import redirect_stdout
from itertools import pairwise
from pathlib import Path

import pytest

import dirprim_filter
import tessellation
from dirprim_filter import filtering
from dirprim_filter.cli.main import run

ROOT = Path(__file__).parents[1]
PAGES = sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "guides").glob("*.md")])
FENCE = re.compile(r"^```(\w+)(?: ([\w.]+))?\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
SHORTER = {
    "n_seeds = 2 ": "n_seeds = 1 ",
    "n_seeds = 5 ": "n_seeds = 1 ",
    "--plot errors.pdf": "--plot errors.pdf --set n_particles=50",
    "n_particles = 1000": "n_particles = 50",
    "learn fleet -o map.mcap": "learn fleet -o map.mcap --tessellation grid --cell-size 20",
    "--tessellation grid --cell-size 8": "--tessellation grid --cell-size 20",
}
"""Of a block, what is replaced: the same path, sooner done."""
WITHOUT_BLOCKS = {"method.md", "results.md"}  # and its figures are of logs that do not ship


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if page.name not in WITHOUT_BLOCKS], ids=lambda p: p.name)
def test_every_block_of_a_page_runs(page, beside_recordings, monkeypatch, capsys):
    shown: list[list[Path]] = []
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)  # where pages say `python`
    monkeypatch.setattr("dirprim_filter.viewer.process.spawn_viewer", shown.append)  # there is no screen
    monkeypatch.setattr("dirprim_filter.viewer.process.screenshot", lambda *_: b"a picture")  # nor a driver, perhaps
    blocks = FENCE.findall(page.read_text())
    assert blocks
    names: dict[str, object] = {}
    for language, file, written in blocks:
        body = written
        for long, short in SHORTER.items():
            body = body.replace(long, short)
        if language == "python":
            exec(compile(body, page.name, "exec"), names)  # noqa: S102 (our own text)
        elif language == "sh":
            for line in body.replace("\\\n", " ").splitlines():
                follow(line)
        else:
            assert file, f"{page.name}: a block of {language} that is no file"
            Path(file).write_text(body)
    assert all(recording.exists() for recordings in shown for recording in recordings)


def follow(line):
    """Run a line of `dirprim`; it ends as its comment says, or well, and leaves what it was reported to write."""
    command, _, comment = line.partition("  # ")
    command, _, captured = command.partition(" > ")
    program, *arguments = shlex.split(command)
    assert program == "dirprim"
    expected = int(comment.removeprefix("ends with ")) if comment else 0
    if captured:
        with Path(captured.strip()).open("w") as out, redirect_stdout(out):
            assert run(arguments) == expected, line
    else:
        assert run(arguments) == expected, line
    for option, value in pairwise(arguments):
        if option in {"-o", "--save"}:
            assert Path(value).stat().st_size > 0, line


@pytest.mark.slow
@pytest.mark.parametrize("notebook", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda p: p.name)
def test_every_cell_of_a_notebook_runs(notebook, beside_recordings, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    names: dict[str, object] = {}
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), notebook.name, "exec"), names)  # noqa: S102 (our own text)
    assert names.get("code", 0) == 0


def test_pages_without_blocks_have_none():
    for name in WITHOUT_BLOCKS:
        assert FENCE.findall((ROOT / "docs" / name).read_text()) == []


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda p: p.name)
def test_commands_in_the_text_and_links_exist(page, capsys):
    text = page.read_text()
    helps: dict[tuple[str, ...], str] = {}
    for said in re.findall(r"`(dirprim [a-z][^`]*)`", FENCE.sub("", text)):
        words = said.split()[1:]
        command = tuple(words[:2] if words[0] in {"evaluate", "store"} else words[:1])
        if command == ("COMMAND",):
            continue
        if command not in helps:
            assert run([*command, "--help"]) == 0, said
            helps[command] = capsys.readouterr().out
        for option in re.findall(r"(?<= )--?[a-z][a-z-]*", said):
            assert f"{option} " in helps[command].replace("\n", " ").replace(",", " "), said
    for link in re.findall(r"\]\(([^)#]+)", text):
        assert "://" in link or (page.parent / link).exists(), link


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_files_that_a_page_names_exist(page):
    packages = [ROOT / name for name in ("dirprim_filter", "tessellation", "tests")]
    files = [str(path) for package in packages for path in package.rglob("*.py")]
    for named in re.findall(r"`([\w/]+\.py)`", page.read_text()):
        assert any(file.endswith("/" + named) for file in files), named


def test_the_reference_has_every_public_name_and_names_nothing_else():
    """`mkdocs build --strict` builds it; here is what that cannot see: names that no page asks for."""
    pages = sorted((ROOT / "docs" / "reference").glob("*.md"))
    shown = [name for page in pages for name in re.findall(r"^::: (\S+)$", page.read_text(), flags=re.MULTILINE)]
    assert len(set(shown)) == len(shown)
    for package in (dirprim_filter, tessellation, filtering):
        public = [getattr(package, name) for name in package.__all__]
        ours = [thing for thing in public if getattr(thing, "__module__", "").startswith(("dirprim_", "tessellation"))]
        assert ours
        for thing in ours:
            assert {thing.__module__, f"{thing.__module__}.{thing.__name__}"} & set(shown), thing
    nav = (ROOT / "mkdocs.yml").read_text()
    assert all(f"reference/{page.name}" in nav for page in pages)
