"""URLs on the command line: which words are some, and how much of one may be shown."""

from __future__ import annotations

import re
from urllib.parse import parse_qsl, urlencode, urlsplit, urlunsplit

_URL = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
_SECRET = re.compile(r"x-(amz|goog|ms)-.*|sig(nature)?|.*token|password|key", re.IGNORECASE)
_WITH_USERS = frozenset(("http", "https", "ftp", "sftp", "ssh", "smb"))


def is_url(text: str) -> bool:
    """Whether a word is a URL; ``file://`` begins one too."""
    return _URL.match(text) is not None


def shown(place: str) -> str:
    """A path as it is; a URL without user, password and signature."""
    if not is_url(place):
        return place
    parts = urlsplit(place)
    host = parts.netloc.rpartition("@")[2] if parts.scheme.lower() in _WITH_USERS else parts.netloc
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    kept = [pair for pair in pairs if not _SECRET.fullmatch(pair[0])]
    query = parts.query if len(kept) == len(pairs) else urlencode(kept)
    return urlunsplit(parts._replace(netloc=host, query=query, fragment=""))
