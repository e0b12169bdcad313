"""Does a file begin as a ULog?"""

from __future__ import annotations

from attlog.formats.ulog.records import MAGIC

ENCRYPTED = b"ULogEnc"
"""How an encrypted one begins, which the reader refuses."""


def is_ulog(head: bytes) -> bool:
    """Whether these first bytes are a ULog's, encrypted or not."""
    return head.startswith((MAGIC, ENCRYPTED))
