"""What ``attlog info`` tells of a log, as plain values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from attlog import formats, reference, segments
from attlog.flight import read
from attlog.health import answerable, audit
from attlog.plain import plain
from attlog.summary import describe


def inspect(path: Path, *, boot: int | None = None, system: int | None = None, verify: bool = False) -> dict[str, Any]:
    """Contents, physics checks, answerable questions and problems of a log.

    Keys: ``log``, ``messages`` (name, instance, records, fields), ``audit``,
    ``answerable``, ``problems``, ``damage``, ``verify`` (None unless asked for). Works on
    logs without inertial data too. LogUnreadable or LogUnusable as in ``attlog.read``.
    """
    log = read(path, boot=boot, system=system)
    phases = segments.build(log) if log.imu is not None else None
    chosen = reference.choose(log, phases) if phases is not None else None
    checks = audit(log, phases, chosen)
    messages = formats.open(path)
    verification = None
    if verify:
        from attlog.formats.verify import verify as compare

        verification = plain(compare(path))
    return {
        "log": plain(describe(log, phases)),
        "messages": [
            {"name": table.name, "instance": table.instance, "records": len(table), "fields": len(table.fields)}
            for table in messages.values()
        ],
        "audit": plain(checks),
        "answerable": plain(answerable(log, phases, checks, chosen)),
        "problems": plain(log.problems),
        "damage": {"bytes": messages.damage_bytes, "places": plain(messages.damage)},
        "verify": verification,
    }
