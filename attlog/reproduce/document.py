"""The JSON of a paper run again."""

from __future__ import annotations

import json

from attlog.base.plain import plain
from attlog.reproduce.paper import Paper


def as_json(paper: Paper, indent: int | None = None) -> str:
    """Claims, numbers, tables, settings; of the figures what they show, not their points (those stand in the page)."""
    return json.dumps(plain(paper), ensure_ascii=False, allow_nan=False, indent=indent) + "\n"
