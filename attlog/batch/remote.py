"""Logs behind URLs, read with fsspec: listing, download and random access."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any
from urllib.parse import SplitResult, parse_qsl, urlencode, urlsplit, urlunsplit

from attlog.batch.log_file import BLOCK, copy
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.core.limits import MAX_FETCH_S, MAX_LISTING_DEPTH, MAX_UNPACKED_BYTES, STALLED_S

_URL = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
# Names of values in a query that open a door, in the spellings of S3, Google, Azure and web servers.
_SECRET = re.compile(
    r"x-(amz|goog|ms)-.*|sig|.*(signature|token|secret|passw|passphrase|pwd|credential|auth|key|accessid|session).*|pass|jwt|code|policy",
    re.IGNORECASE,
)
# Where a URL names what it lies behind.
_BEHIND = re.compile(rf"::(?={_URL.pattern})", re.IGNORECASE)
_WITH_USERS = frozenset(("http", "https", "ftp", "sftp", "ssh", "smb"))


def is_url(text: str) -> bool:
    """Return True for a URL, also of ``file://``."""
    return _URL.match(text) is not None


def without_secrets(place: str) -> str:
    """Return a path unchanged, and a URL without user, password and signature."""
    if len(behind := _BEHIND.split(place)) > 1:  # zip://a.ulg::https://...
        return "::".join(map(without_secrets, behind))
    if not is_url(place):
        return place
    parts = _parts(place)
    user, _, host = parts.netloc.rpartition("@")
    if parts.scheme.lower() not in _WITH_USERS and ":" not in user:  # abfs://container@account
        host = parts.netloc
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    kept = [pair for pair in pairs if not _SECRET.fullmatch(pair[0])]
    query = parts.query if len(kept) == len(pairs) else urlencode(kept)
    return urlunsplit(parts._replace(netloc=host, query=query, fragment=""))


def hide_secrets(text: str) -> str:
    """Return a text with every URL in it as by :func:`without_secrets`, what follows a wrong one cut off."""

    def hidden(url: re.Match[str]) -> str:
        try:
            return without_secrets(url[0])
        except UsageError:
            return f"{url[0].partition('://')[0]}://…"

    return re.sub(rf"{_URL.pattern}\S+", hidden, text, flags=re.IGNORECASE)


# Waits before the second and third attempt at an interrupted download.
WAITS_S = (1.0, 4.0)
# HTTP status codes that another attempt will not change.
_LASTING = frozenset((400, 401, 403, 404, 405, 410, 416, 451))


def expand_url(url: str, wanted: Any) -> list[str]:
    """Expand the URL of a pattern or folder to the ``wanted`` URLs.

    Any other URL is returned unchanged. A web server's folder is listed only if its URL ends with ``/``. LogUnreadable
    if the place cannot be listed or has nothing wanted, UsageError if a package is missing.
    """
    web = _is_web(url)
    pattern = "*" in (urlsplit(url).path if web else url) or (not web and any(c in url for c in "?["))
    if web and not pattern and not urlsplit(url).path.endswith("/"):
        return [url]
    try:
        files, path = _file_system(url)
        if pattern:
            found = files.glob(path, maxdepth=MAX_LISTING_DEPTH if "**" in path else None)
            found = [f for f in found if not f.endswith("/")]
        elif web or files.isdir(path):
            found = files.find(path, maxdepth=MAX_LISTING_DEPTH)
        else:
            return [url]
        if web and not found:  # the search skips a folder whose server is missing: listing it raises the error
            files.ls(path.partition("*")[0].rpartition("/")[0] + "/", detail=False)
    except AttlogError:
        raise
    except Exception as error:  # each file system has its own exceptions
        raise _failed(url, error) from error
    logs = [files.unstrip_protocol(f) for f in sorted(found) if wanted(f)]
    if not logs:
        what = f"none of the {len(found)} files that match is called like a flight log" if found else "nothing there"
        raise LogUnreadable(f"{without_secrets(url)}: {what}")
    return logs


def download(url: str, path: Path) -> tuple[str, int]:
    """Download a URL to a file; return SHA-256 and size. Errors as :meth:`attlog.batch.sources.Source.local`."""
    for wait in (*WAITS_S, None):
        try:
            return copy(_blocks(url), path)
        except AttlogError:
            raise
        except Exception as error:  # each file system has its own exceptions
            if wait is None or not _passing(error):
                raise _failed(url, error) from error
            time.sleep(wait)
    raise AssertionError("the last attempt returns or raises")


@contextmanager
def random_access(url: str) -> Iterator[IO[bytes] | None]:
    """Open a file behind a URL for random access, else yield None."""
    try:
        files, path = _file_system(url)
        file = files.open(path, "rb")
        file.seek(-1, 2)
        reads = len(file.read(2)) == 1
    except AttlogError:
        raise
    except Exception:  # the download will report it
        reads = False
    if not reads:
        yield None
        return
    with file:
        yield file


def url_stamp(url: str) -> str:
    """Return ETag or time, and size, of a file; empty without both."""
    try:
        files, path = _file_system(url)
        info = files.info(path)
    except AttlogError:
        raise
    except Exception as error:  # each file system has its own exceptions
        raise _failed(url, error) from error
    tags = ("ETag", "etag", "md5Hash", "Content-MD5", "Last-Modified", "LastModified", "mtime", "updated", "created")
    tag = next((str(info[key]) for key in tags if info.get(key)), "")
    return f"{info.get('size')}-{tag}" if tag else ""


def _blocks(url: str) -> Iterator[bytes]:
    files, path = _file_system(url)
    # Fetch a web file in a single request, whatever its server reports about ranges and sizes.
    options = {"block_size": 0, "size": 1} if _is_web(url) else {}
    expected = None if options else files.info(path).get("size")
    given, until = 0, time.monotonic() + MAX_FETCH_S
    with files.open(path, "rb", **options) as file:
        while block := file.read(BLOCK):
            given += len(block)
            if given > MAX_UNPACKED_BYTES:
                raise LogUnusable(f"{without_secrets(url)}: more than {MAX_UNPACKED_BYTES >> 30} GB; no log is so long")
            if time.monotonic() > until:
                raise TimeoutError(f"not there after {MAX_FETCH_S:.0f} s")
            yield block
    if expected is not None and given < expected:
        raise EOFError(f"cut short: {given} of {expected} bytes came")


def _file_system(url: str) -> tuple[Any, str]:
    """Return the file system of a URL and the path in it.

    UsageError if a package is missing.
    """
    options: dict[str, Any] = {"use_listings_cache": False}
    try:
        import fsspec

        if _is_web(url):
            import aiohttp

            patience = aiohttp.ClientTimeout(total=None, sock_connect=STALLED_S, sock_read=STALLED_S)
            options["client_kwargs"] = {"timeout": patience, "trust_env": True}
        files, path = fsspec.core.url_to_fs(url, **options)
    except ImportError as error:
        raise UsageError(
            f"{without_secrets(url)}: URLs need packages that are not installed ({error}): "
            'pip install "fsspec[http,s3,gcs]", or pip install ".[remote]" in the source folder'
        ) from None
    except ValueError as error:
        raise UsageError(f"{without_secrets(url)}: {error}") from None
    return files, path


def _is_web(url: str) -> bool:
    return _parts(url).scheme.lower() in ("http", "https")


def _parts(url: str) -> SplitResult:
    """Return the parts of a URL. UsageError, without its text, if it has none, as ``http://[::1``."""
    try:
        return urlsplit(url)
    except ValueError:
        raise UsageError(f"{url.partition('://')[0]}://…: not a URL that can be read") from None


def _cause(error: BaseException) -> BaseException:
    """Return the cause of an error: fsspec reports any failure as a missing file."""
    found = error.__cause__ if isinstance(error, FileNotFoundError) else None
    return error if found is None else _cause(found)


def _passing(failure: Exception) -> bool:
    """Return True if another attempt may help."""
    error = _cause(failure)
    return not isinstance(error, FileNotFoundError | PermissionError) and getattr(error, "status", 0) not in _LASTING


def _failed(url: str, failure: Exception) -> LogUnreadable:
    """Return the error of a URL in one sentence."""
    name, error = without_secrets(url), _cause(failure)
    if isinstance(error, FileNotFoundError):
        return LogUnreadable(f"{name}: no such file")
    if getattr(error, "status", 0):
        return LogUnreadable(f"{name}: the server answers {error.status} {getattr(error, 'message', '')}".rstrip())  # type: ignore[attr-defined]
    if isinstance(error, TimeoutError):
        return LogUnreadable(f"{name}: timed out ({str(error) or f'nothing came for {STALLED_S:.0f} s'})")
    reason = str(error).replace(url, name).strip() or type(error).__name__
    return LogUnreadable(f"{name}: cannot be downloaded ({reason})")
