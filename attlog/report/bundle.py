"""The plotly.js that a report carries: the small bundle where the installation has it, else the full one.

The small one (scatter, bar, pie) is put into ``bundle/`` by the build hook and draws
every figure here; the full one comes with the Python package plotly, is four times
as large and starts about ten times slower.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import shlex
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import urlsplit

FOLDER = Path(__file__).parent / "bundle"
SMALL = "plotly-basic.min.js.gz"

EMPTY_STYLE = "sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU="
"""plotly makes an empty ``<style>`` and fills it through the CSSOM."""

FULL_STYLE = "sha256-ji27qzEtxXZW+7dun6UwjHXJ18e6WAin1VvNtkzIE/o="
"""A style element that the map code of the full bundle (4.1.1) adds as text."""


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle ready to be packed: its script, how it is named, the style hashes it needs."""

    name: str
    script: bytes
    packed: bytes
    styles: tuple[str, ...]
    small: bool

    @property
    def hash(self) -> str:
        """The script's hash for the policy and for ``integrity``."""
        return source_hash(self.script)


def source_hash(text: bytes) -> str:
    """The sha256 of a script or style in the form of a content-security policy."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text).digest()).decode()


def bundle(folder: Path = FOLDER) -> Bundle:
    """The small bundle of this installation, else the full one of the Python package."""
    return _unpacked(folder)


@cache
def _unpacked(folder: Path) -> Bundle:
    try:
        packed = (folder / SMALL).read_bytes()
        version = (folder / "stamp").read_text(encoding="utf-8").split()[1]
        script = gzip.decompress(packed)
        if not script:
            raise EOFError(f"{SMALL} is empty")
        return Bundle(f"plotly-basic-{version}.min.js", script, packed, (EMPTY_STYLE,), True)
    except (OSError, EOFError, IndexError):
        from plotly.offline import get_plotlyjs, get_plotlyjs_version

        script = get_plotlyjs().encode("utf-8")
        packed = gzip.compress(script, 6, mtime=0)
        return Bundle(f"plotly-{get_plotlyjs_version()}.min.js", script, packed, (EMPTY_STYLE, FULL_STYLE), False)


def bundle_notice(folder: Path = FOLDER) -> str | None:
    """What to tell the user where reports have to carry the full bundle; None where all is well."""
    if bundle(folder).small:
        return None
    source = source_folder()
    if source is None:
        again = "in the folder of its source: python -m pip install --force-reinstall --no-deps ."
    else:
        editable = "-e " if source == Path(__file__).parents[2] else ""
        folder_name = shlex.quote(str(source))
        again = f"{shlex.quote(sys.executable)} -m pip install --force-reinstall --no-deps {editable}{folder_name}"
    return (
        "reports carry the full plotly.js (1.5 MB more, slower to open) because the small one could not be fetched "
        f"when attlog was installed; with network, this fetches it: {again}"
    )


def source_folder() -> Path | None:
    """The folder that this attlog was installed from, None where it is not known or gone."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        url = json.loads(distribution("attlog").read_text("direct_url.json") or "{}").get("url", "")
    except (PackageNotFoundError, ValueError):  # run without an installation, or one that tells something else
        url = ""
    folders = [Path(__file__).parents[2]]
    if url.startswith("file:"):
        from urllib.request import url2pathname

        folders.append(Path(url2pathname(urlsplit(url).path)))
    return next((folder for folder in folders if (folder / "hatch_build.py").is_file()), None)
