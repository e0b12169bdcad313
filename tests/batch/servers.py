"""A web server on loopback that misbehaves on demand."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass
class Web:
    """What the server holds and how often each path was asked for."""

    files: dict[str, bytes] = field(default_factory=dict)
    ranges: bool = True
    asked: list[tuple[str, str]] = field(default_factory=list)
    url: str = ""
    failures: int = 0
    """So many requests of ``/flaky/`` break off half way before one succeeds."""


@contextmanager
def serving() -> Iterator[Web]:
    """A server on a free port, as long as the context lasts."""
    web = Web()
    over = threading.Event()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def do_HEAD(self) -> None:
            self.answer(body=False)

        def do_GET(self) -> None:
            self.answer(body=True)

        def answer(self, body: bool) -> None:
            path = self.path
            web.asked.append((self.command, path))
            if path.startswith("/moved/"):
                return self.reply(302, b"", {"Location": path.removeprefix("/moved")})
            if path.startswith("/broken"):
                return self.reply(500, b"")
            if path.startswith("/secret"):
                return self.reply(403, b"")
            if path.endswith("/"):
                names = sorted(name for name in web.files if name.startswith(path) and name != path)
                below = sorted({re.sub(r"/.*", "/", name.removeprefix(path)) for name in names})
                page = "".join(f'<a href="{name}">{name}</a>\n' for name in ["../", "?C=N;O=D", *below])
                return self.reply(200, page.encode(), {"Content-Type": "text/html"}, body)
            data = web.files.get(path.removeprefix("/flaky").removeprefix("/stalled"))
            if data is None and any(name.startswith(f"{path}/") for name in web.files):
                return self.reply(301, b"", {"Location": f"{path}/"})
            if data is None:
                return self.reply(404, b"")
            head = {"Last-Modified": "Sun, 22 Nov 2026 07:41:00 GMT"}
            if body and (path.startswith("/stalled/") or (path.startswith("/flaky/") and web.failures)):
                web.failures -= path.startswith("/flaky/")
                self.send_response(200)
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data[: len(data) // 2])
                self.wfile.flush()
                if path.startswith("/stalled/"):
                    over.wait(20)
                self.close_connection = True
                return None
            wanted = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
            if web.ranges and wanted:
                first, last = int(wanted[1]), min(int(wanted[2]), len(data) - 1)
                head["Content-Range"] = f"bytes {first}-{last}/{len(data)}"
                return self.reply(206, data[first : last + 1], head, body)
            if web.ranges:
                head["Accept-Ranges"] = "bytes"
            return self.reply(200, data, head, body)

        def reply(self, code: int, data: bytes, head: dict[str, str] | None = None, body: bool = True) -> None:
            self.send_response(code)
            for key, value in (head or {}).items():
                self.send_header(key, value)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            if body:
                self.wfile.write(data)

    class Server(ThreadingHTTPServer):
        daemon_threads = True

        def handle_error(self, *_: object) -> None:
            pass  # a client that gives up is part of the test

    server = Server(("127.0.0.1", 0), Handler)
    web.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield web
    finally:
        over.set()
        server.shutdown()
        thread.join()
        server.server_close()
