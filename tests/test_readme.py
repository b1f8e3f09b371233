"""What the README says works, word for word; on cut-down logs of the recordings' names."""

import re
import tomllib
from pathlib import Path

from ruamel.yaml import YAML  # rosbags brings it

from test_docs import FENCE, ROOT, follow

README = (ROOT / "README.md").read_text()
BLOCKS = FENCE.findall(README)


def test_there_are_two_set_up_commands_of_one_line_each():
    setups = [body for language, kind, body in BLOCKS if language == "sh" and kind in {"demo", "tests"}]
    assert len(setups) == 2
    assert all(body.count("\n") == 1 for body in setups)
    assert setups[0].rstrip().endswith(".venv/bin/dirprim demo")


def test_the_python_example_and_the_commands_run(beside_recordings, capsys):
    (code,) = [body for language, _, body in BLOCKS if language == "python"]
    assert len(code.splitlines()) <= 10
    exec(compile(code, "README.md", "exec"), {})  # noqa: S102 (our own text)
    assert "cells" in capsys.readouterr().out
    (written,) = re.findall(r'save_map\(m, "([^"]+)"\)', code)
    assert Path(written).exists()
    (commands,) = [body for language, kind, body in BLOCKS if kind == "commands"]
    for line in commands.splitlines():
        follow(line)


def test_the_citation_is_of_this_version_and_of_the_paper():
    with (ROOT / "CITATION.cff").open() as file:
        cited = YAML(typ="safe").load(file)
    assert cited["cff-version"] == "1.2.0"
    assert cited["version"] == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    paper = cited["preferred-citation"]
    names = [author["family-names"] for author in paper["authors"]]
    assert names == ["Senanayake", "Toyungyernsub", "Wang", "Kochenderfer", "Schwager"]
    assert f"*{paper['title']}*, {paper['year']}" in " ".join(README.split())
