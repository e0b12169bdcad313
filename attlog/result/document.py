"""A result as its JSON document: nothing that a reader knows anyway, and nothing twice.

What has its default is left out. :mod:`attlog.result.answers` tells how answers are written, which are most of it.
"""

from __future__ import annotations

import re
from typing import Any

from attlog.base.plain import plain, without
from attlog.result import answers

SCHEMA_NAME, SCHEMA_NUMBER = "attlog-result/", 6
SCHEMA = f"{SCHEMA_NAME}{SCHEMA_NUMBER}"
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
"""What differs between two runs of the same log; ``--deterministic`` leaves it out."""
NOT_UTF8 = re.compile("[\ud800-\udfff]")
"""Bytes of a file name that are not UTF-8, as Python keeps them: UTF-8 cannot hold them, a JSON escape can."""


def document(result: Any, deterministic: bool = False) -> dict[str, Any]:
    """The JSON document of a :class:`~attlog.result.Result`; ``deterministic``: without what another run may change."""
    found: dict[str, Any] = {"schema": SCHEMA} | plain(result, defaults=False) | {"schema": SCHEMA}
    if deterministic:
        found = without(found, MEASURED_TIMES) | {"command": ""}
    return found | answers.shorten(found.get("estimators", []))
