"""Every block of the manual runs as it stands: files are written, commands and Python are run, shown output comes."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from cosim.report.manual import CONTENTS
from tests.support.paths import ROOT

ELSEWHERE = "own-controller"  # tests/api/test_own_models.py
SOURCES = {slug: ROOT / source for _, slug, source in CONTENTS if source.startswith("cosim/manual/")}
RUNNING = [slug for slug, path in SOURCES.items() if slug != ELSEWHERE and "```" in path.read_text(encoding="utf-8")]


def blocks(path: Path) -> list[tuple[str, str, str]]:
    """Language, file name (behind `>`) and content of every fenced block."""
    tokens = MarkdownIt("commonmark").parse(path.read_text(encoding="utf-8"))
    parts = [(t.info.partition(">"), t.content) for t in tokens if t.type == "fence"]
    return [(language.strip(), name.strip(), content) for (language, _, name), content in parts]


def commands(text: str) -> list[tuple[str, list[str]]]:
    """Commands of a console block, each with the lines that are shown after it."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        elif line.strip():
            found[-1][1].append(line)
    return found


def run(words: list[str], folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=280, check=False
    )
    assert done.returncode == 0, (words, done.stdout, done.stderr)
    return done.stdout + done.stderr


@pytest.mark.parametrize("slug", [s if s == "scenario" else pytest.param(s, marks=pytest.mark.slow) for s in RUNNING])
def test_blocks(slug, tmp_path):
    assert blocks(SOURCES[slug])
    for language, name, text in blocks(SOURCES[slug]):
        assert language in ("console", "python", "toml", "c", "json"), (slug, language)
        if name:
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text, encoding="utf-8")
        if language == "python":
            run(["-c", text], tmp_path)
        for command, shown in commands(text) if language == "console" else ():
            program, *words = shlex.split(command)
            module = {"cosim": "cosim", "build-fmus": "build_fmus", "python": None}[program]
            output = run(["-m", module, *words] if module else words, tmp_path)
            for line in shown:
                pattern = re.escape(line.strip()).replace(r"\.\.\.", ".*")
                assert any(re.search(pattern, got) for got in output.splitlines()), (command, line, output)
