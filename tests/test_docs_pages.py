"""The documents read alike on GitHub and as pages that mkdocs builds: links, headings they point to, tables, lists."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import pytest

from tests.conftest import ROOT

PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for pattern in ("*.md", "docs/*.md", "sample_logs/*.md", "benchmarks/*.md")
    for path in ROOT.glob(pattern)
)
ITEM = re.compile(r"([-*+]|\d+\.)\s")


def prose(path: Path) -> list[str]:
    """The lines outside code blocks; what stands in a block is left as an empty line."""
    lines, inside = [], False
    for line in path.read_text(encoding="utf-8").splitlines():
        fence = line.lstrip().startswith(("```", "~~~"))
        lines.append("" if fence or inside else line)
        inside ^= fence
    assert not inside, f"{path}: a code block has no end"
    return lines


def headings(path: Path) -> Iterator[str]:
    """The texts of a page's headings as they are shown."""
    for line in prose(path):
        found = re.match(r"#{1,6}\s+(.*?)\s*#*$", line)
        if found:
            yield re.sub(r"[`*]", "", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", found[1]))


def anchors(path: Path) -> set[str]:
    """What a link may name of a page: anchors that are alike on GitHub (each space a hyphen) and of Python-Markdown
    (runs of them one hyphen, ASCII alone)."""
    told = list(headings(path))
    github = [re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in told]
    built = [re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", each).strip().lower()) for each in told]
    once = Counter(github)
    return {name for name, other in zip(github, built, strict=True) if name == other and once[name] == 1}


def links(path: Path) -> list[str]:
    """Targets of links and images that lie in the repository."""
    text = re.sub(r"`[^`\n]*`", "", "\n".join(prose(path)))
    found = re.findall(r"\]\(([^)\s]+)(?:\s+\"[^\"]*\")?\)", text)
    return [target for target in found if not re.match(r"[a-z]+:", target)]


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_to_a_file_and_every_anchor_to_a_heading(page: str) -> None:
    path, lost = ROOT / page, []
    for link in links(path):
        name, _, anchor = unquote(link).partition("#")
        target = path.parent / name if name else path
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    assert lost == []


def test_links_of_the_pages_are_found_at_all() -> None:
    found = [link for page in PAGES for link in links(ROOT / page)]
    assert len(found) > 100
    assert sum("#" in link for link in found) > 5
    assert "docs/report.png" in found


@pytest.mark.parametrize("page", PAGES)
def test_every_row_of_a_table_has_as_many_cells_as_its_head(page: str) -> None:
    """Where one has more, GitHub drops the last; where a paragraph stands right above, mkdocs shows no table."""
    lines = prose(ROOT / page)
    cells = [len(re.split(r"(?<!\\)\|", line.strip())) - 2 if line.startswith("|") else 0 for line in lines]
    for number, line in enumerate(lines):
        if line.startswith("|") and (number == 0 or not cells[number - 1]):
            above = lines[number - 1] if number else ""
            assert not above.strip() or above.startswith("#"), f"{page}:{number + 1}: a paragraph right above the table"
            assert re.fullmatch(r"\|(\s*:?-+:?\s*\|)+", lines[number + 1].strip()), f"{page}:{number + 1}: no head"
            end = next((i for i in range(number, len(lines)) if not cells[i]), len(lines))
            assert set(cells[number:end]) == {cells[number]}, f"{page}:{number + 1}: rows differ in cells"


@pytest.mark.parametrize("page", PAGES)
def test_every_list_has_an_empty_line_above(page: str) -> None:
    """GitHub begins a list without one, mkdocs goes on with the paragraph."""
    paragraph = item = False
    for number, line in enumerate(prose(ROOT / page), 1):
        if ITEM.match(line):
            assert not paragraph, f"{page}:{number}: the list runs into the paragraph above"
            item = True
        elif not line.strip() or line.startswith("#"):
            paragraph = item = False
        else:
            paragraph = not item and not line.startswith("  ")
