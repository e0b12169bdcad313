"""Does a file begin as a ULog?"""

from __future__ import annotations

from attlog.formats.ulog.records import MAGIC

ENCRYPTED, KEY_FILE = b"ULogEnc", b"ULogKey"
"""How an encrypted one begins, and the key beside an encrypted one of PX4 1.13 to 1.15."""


def is_ulog(head: bytes) -> bool:
    """Whether these first bytes are a ULog's, encrypted or not."""
    return head.startswith((MAGIC, ENCRYPTED, KEY_FILE))
