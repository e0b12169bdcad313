"""The plotly.js bundle of a page, and its packed arrays.

The small bundle (scatter, bar, pie) is copied into ``bundle/`` by the build hook and draws every figure here. The full
one comes with the Python package plotly, is four times as large and starts about ten times slower.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import math
import shlex
import sys
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from attlog.core.plain import json_text

FOLDER = Path(__file__).parent / "bundle"
SMALL = "plotly-basic.min.js.gz"

# Hash of the empty ``<style>`` that plotly creates and fills through the CSSOM.
EMPTY_STYLE = "sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU="

# Style element that the map code of the full bundle (4.1.1) adds as text.
FULL_STYLE = "sha256-ji27qzEtxXZW+7dun6UwjHXJ18e6WAin1VvNtkzIE/o="


class Bundle(NamedTuple):
    """plotly.js bundle: script, name and hashes of the styles that it adds."""

    name: str
    script: bytes
    packed: bytes
    styles: tuple[str, ...]
    small: bool

    @property
    def hash(self) -> str:
        """Hash of the script, for the content-security policy and ``integrity``."""
        return source_hash(self.script)


def source_hash(text: bytes) -> str:
    """Return the sha256 of a script or style as a content-security policy states it."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text).digest()).decode()


def bundle(folder: Path = FOLDER) -> Bundle:
    """Return the small bundle of this installation, else the full one of plotly."""
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
    """Return the notice that reports carry the full bundle; None with the small one."""
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
    """Return the folder that this attlog was installed from; None if unknown or gone."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        url = json.loads(distribution("attlog").read_text("direct_url.json") or "{}").get("url", "")
    except (PackageNotFoundError, ValueError):  # run without an installation, or its metadata has another form
        url = ""
    folders = [Path(__file__).parents[2]]
    if url.startswith("file:"):
        from urllib.request import url2pathname

        folders.append(Path(url2pathname(urlsplit(url).path)))
    return next((folder for folder in folders if (folder / "hatch_build.py").is_file()), None)


# Compact encoding of arrays: quantised to int16 and stored as differences with wrap-around, whose sum restores the
# integers. The sign of a difference is its lowest bit (zigzag encoding), so that the high bytes of smooth lines are
# zero. Low bytes come first, then high bytes, which gzip compresses best.

Array = NDArray[np.float64]

# The int16 code of NaN.
NAN_CODE = -32768

MAX_CODE = 32766
# Quantisation step of times; coarser only for logs beyond two days.
TIME_STEP_S = 1e-4

# gzip level: level 4 takes 25 instead of 17 ms for a page and saves 7 %.
GZIP_LEVEL = 1


class ArrayPacker:
    """Collect arrays for the page; equal arrays are stored once.

    ``values`` and ``times`` return the place of an array for the JSON header: ``s`` step, ``o`` first byte, ``n``
    length, ``w`` bytes of an integer. For the encoding see above.
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._places: dict[bytes, int] = {}
        self._times: dict[bytes, dict[str, Any]] = {}

    def values(self, y: Array, step: float = 1e-9) -> dict[str, Any]:
        """Pack values as int16 multiples of ``step``, coarser if needed; NaN is kept."""
        largest = float(np.abs(y).max(initial=0.0))
        if math.isfinite(largest):
            step = _round_step(max(step, largest / MAX_CODE))
            return self._put(np.rint(y / step).astype(np.int16), step)
        finite = np.isfinite(y)
        step = _round_step(max(step, float(np.abs(y[finite]).max(initial=0.0)) / MAX_CODE))
        return self._put(np.where(finite, np.rint(y / step), NAN_CODE).astype(np.int16), step)

    def centred(self, y: Array) -> dict[str, Any]:
        """Pack values as multiples of a step from the middle of their range (``b``); NaN is kept."""
        finite = y[np.isfinite(y)]
        low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 0.0)
        middle = 0.5 * low + 0.5 * high
        return self.values(y - middle, 1e-300) | {"b": middle}

    def times(self, t: Array) -> dict[str, Any]:
        """Pack times as int32 steps; most rows share their times."""
        given = t.tobytes()
        if given not in self._times:
            t = np.nan_to_num(t)
            step = _round_step(max(TIME_STEP_S, float(np.abs(t).max(initial=0.0)) / 2.0e9))
            self._times[given] = self._put(np.rint(t / step).astype(np.int32), step)
        return self._times[given]

    def pack(self, header: Any) -> str:
        """Return JSON header (length in 4 bytes before it) and arrays, gzipped as base64."""
        text = json_text(header).encode("utf-8", "replace")
        return packed(len(text).to_bytes(4, "little") + text + bytes(self._bytes))

    def _put(self, whole: NDArray[Any], step: float) -> dict[str, Any]:
        change, bits = whole.copy(), 8 * whole.itemsize
        np.subtract(whole[1:], whole[:-1], out=change[1:])
        zigzag = change << 1 ^ change >> (bits - 1)
        raw = b"".join((zigzag >> shift).astype(np.uint8).tobytes() for shift in range(0, bits, 8))
        place = self._places.setdefault(raw, len(self._bytes))
        if place == len(self._bytes):
            self._bytes += raw
        return {"s": step, "o": place, "n": len(whole), "w": whole.itemsize}


def packed(raw: bytes) -> str:
    """Gzip reproducibly and encode as base64, for ``<script type="application/gzip">``."""
    return base64.b64encode(gzip.compress(raw, GZIP_LEVEL, mtime=0)).decode()


def _round_step(step: float) -> float:
    """Round a step up to few digits, so that the range still fits."""
    scale = 10.0 ** (3 - math.floor(math.log10(step)))
    return math.ceil(step * scale) / scale
