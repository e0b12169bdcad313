"""A page of its own for tables and drawings: one file, no request, a strict content-security policy."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Sequence
from html import escape as escaped
from pathlib import Path

from attlog.present.text import clean
from attlog.report.page import WEB as REPORT

WEB = Path(__file__).parent / "web"
Table = tuple[Sequence[str], Sequence[Sequence[str]]]


def escape(text: str) -> str:
    """Text as HTML, without what would hide or turn round what stands beside it."""
    return escaped(clean(text))


def page(name: str, title: str, subtitle: str, parts: Iterable[str]) -> str:
    """A whole page; ``name`` begins the names of files saved from it. ``parts`` are HTML."""
    style, *scripts = (
        file.read_text(encoding="utf-8") for file in (WEB / "page.css", REPORT / "spreadsheet.js", WEB / "page.js")
    )
    script = "\n".join(["'use strict';", *scripts])
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{escape(title)}</title>'
        f'<style>{style}</style></head><body data-name="{escape(name)}"><main><h1>{escape(title)}</h1>'
        f'<p class="mu">{escape(subtitle)}</p>{"".join(parts)}</main><script>{script}</script></body></html>\n'
    )


def said(sentences: Iterable[str]) -> str:
    """Sentences, each in its box."""
    return "".join(f'<p class="say">{escape(s)}</p>' for s in sentences)


def heading(words: str) -> str:
    """A heading."""
    return f"<h2>{escape(words)}</h2>"


def table(content: Table, left: int = 1) -> str:
    """A table that can be saved as CSV; the first ``left`` columns and the last hold words."""
    head, rows = content
    last = len(head) - 1

    def cell(tag: str, i: int, words: str) -> str:
        return f"<{tag}{' class=l' if i < left or i == last else ''}>{escape(words)}</{tag}>"

    titles = "".join(cell("th", i, words) for i, words in enumerate(head))
    lines = "".join(f"<tr>{''.join(cell('td', i, words) for i, words in enumerate(row))}</tr>" for row in rows)
    whole = f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    return f'<div><div class="scroll">{whole}</div><button class="csv">CSV</button></div>'


def figures(found: Iterable[tuple[str, str]]) -> str:
    """Drawings with their captions, each of which can be saved as SVG or PNG."""
    items = "".join(
        f'<figure><div class="pic">{drawing}</div><figcaption>{escape(caption)} '
        '<button class="svg">SVG</button> <button class="png">PNG</button></figcaption></figure>'
        for caption, drawing in found
    )
    return f'<div class="figs">{items}</div>'


def code(text: str) -> str:
    """Text to be copied."""
    return f"<pre>{escape(text)}</pre>"


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
