"""Which plotly.js a report carries, how it gets there, and what happens without it."""

from __future__ import annotations

import base64
import gzip
import hashlib
import importlib.util
import io
import json
import re
import shlex
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from attlog.report import bundle_notice
from attlog.report.bundle import FOLDER, SMALL, ArrayPacker, bundle
from attlog.report.page import render
from tests.report.browser import own_bytes
from tests.report.conftest import make_result

ROOT = Path(__file__).resolve().parents[2]
PIN = tomllib.loads((ROOT / "plotlyjs.toml").read_text(encoding="utf-8"))


@pytest.fixture
def hook():
    """The build hook as a module, without building anything."""
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def source(tmp_path):
    """A source tree with the pin of a package that the test makes itself."""
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w:gz") as package:
        for name, text in (("package/plotly-basic.min.js", b"window.Plotly={}"), ("package/LICENSE", b"MIT")):
            info = tarfile.TarInfo(name)
            info.size = len(text)
            package.addfile(info, io.BytesIO(text))
    digest = base64.b64encode(hashlib.sha512(archive.getvalue()).digest()).decode()
    pin = {**PIN, "integrity": f"sha512-{digest}"}
    (tmp_path / "plotlyjs.toml").write_text("".join(f'{k} = "{v}"\n' for k, v in pin.items()))
    return tmp_path, archive.getvalue()


def test_the_pin_has_the_version_of_the_python_package():
    pytest.importorskip("plotly")
    from plotly.offline import get_plotlyjs_version

    installed = tuple(map(int, get_plotlyjs_version().split(".")))
    assert installed <= tuple(map(int, PIN["version"].split("."))), "a newer one has come out; older ones draw as well"
    assert PIN["integrity"].startswith("sha512-")


def test_the_hook_checks_writes_and_stamps(hook, source, monkeypatch):
    root, archive = source
    asked = []
    monkeypatch.setattr(hook, "npm_pack", lambda package, folder: asked.append(package) or archive)
    assert hook.fetch(root) is True
    folder = root / "attlog/report/bundle"
    assert gzip.decompress((folder / SMALL).read_bytes()) == b"window.Plotly={}"
    assert (folder / "LICENSE").read_bytes() == b"MIT"
    assert hook.fetch(root) is False
    assert asked == [f"{PIN['package']}@{PIN['version']}"]
    assert bundle(folder).small
    assert bundle_notice(folder) is None


def test_a_wrong_hash_leaves_nothing_behind(hook, source, monkeypatch):
    root, archive = source
    monkeypatch.setattr(hook, "npm_pack", lambda package, folder: archive + b"x")
    with pytest.raises(ValueError, match="expected"):
        hook.fetch(root)
    assert not (root / "attlog").exists()


@pytest.mark.parametrize(("wanted", "raises"), [("", False), ("basic", True), ("full", False)])
def test_a_failing_fetch_breaks_the_build_only_where_the_bundle_is_demanded(hook, source, monkeypatch, wanted, raises):
    root, _ = source
    monkeypatch.setenv("ATTLOG_BUNDLE", wanted)

    def broken(package, folder):
        raise RuntimeError("npm failed: no network")

    monkeypatch.setattr(hook, "npm_pack", broken)
    said = []
    built = hook.BundleHook.__new__(hook.BundleHook)
    application = type("Application", (), {"display_warning": staticmethod(said.append)})
    monkeypatch.setattr(hook.BundleHook, "root", property(lambda self: str(root)))
    monkeypatch.setattr(hook.BundleHook, "app", property(lambda self: application))
    monkeypatch.setattr(hook.BundleHook, "target_name", "sdist")  # which compiles no kernels
    if raises:
        with pytest.raises(RuntimeError):
            built.initialize("standard", {})
    else:
        built.initialize("standard", {})
        assert len(said) == (wanted == "")


def test_npm_is_asked_for_the_exact_package_without_scripts(hook, monkeypatch, tmp_path):
    calls = []

    def run(command, **options):
        calls.append(command)
        (tmp_path / "x.tgz").write_bytes(b"archive")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(hook.shutil, "which", lambda name: "/usr/bin/npm")
    monkeypatch.setattr(hook.subprocess, "run", run)
    assert hook.npm_pack("name@1.2.3", tmp_path) == b"archive"
    assert calls[0][:3] == ["/usr/bin/npm", "pack", "name@1.2.3"]
    assert "--ignore-scripts" in calls[0]
    assert not any("registry" in word for word in calls[0])


def test_without_npm_node_comes_from_a_wheel(hook, monkeypatch, tmp_path):
    calls = []
    monkeypatch.setattr(hook.shutil, "which", lambda name: None)
    monkeypatch.setattr(hook, "run", lambda command, folder: calls.append(command))
    command = hook.npm(tmp_path)
    assert command[0].endswith("bin/node")
    assert command[1].endswith("npm-cli.js")
    assert "--only-binary" in calls[0]
    assert hook.NODE_WHEEL in calls[0]


def test_a_missing_bundle_falls_back_to_the_full_one_and_says_so(tmp_path):
    full = bundle(tmp_path)
    assert not full.small
    command = bundle_notice(tmp_path).rpartition("this fetches it: ")[2]
    python, *arguments, folder = shlex.split(command)
    assert python == sys.executable
    assert arguments == ["-m", "pip", "install", "--force-reinstall", "--no-deps", "-e"]
    assert (Path(folder) / "hatch_build.py").is_file()
    assert len(full.styles) == 2


@pytest.mark.parametrize(
    "content", [b"", b"not gzip", gzip.compress(b"x" * 1000, mtime=0)[:20]], ids=["empty", "text", "cut"]
)
def test_a_damaged_bundle_falls_back_too(tmp_path, content):
    (tmp_path / SMALL).write_bytes(content)
    (tmp_path / "stamp").write_text(f"{PIN['package']} {PIN['version']} x\n")
    assert not bundle(tmp_path).small


@pytest.mark.slow
def test_the_full_bundle_draws_under_its_policy(visit, tmp_path):
    path = tmp_path / "full.html"
    path.write_text(render(make_result(), bundle(tmp_path)), encoding="utf-8")
    page = visit(path)
    assert page.complaints == []
    assert page.requests == [path.as_uri()]
    assert [name for name, drawn in page.figures().items() if not drawn] == []
    assert own_bytes(path) < 2_400_000


def test_the_installed_bundle_is_the_pinned_one():
    if not (FOLDER / SMALL).is_file():
        pytest.skip("this installation has no small bundle (no npm and no network when it was installed)")
    assert (FOLDER / "stamp").read_text().split() == [PIN["package"], PIN["version"], PIN["integrity"]]
    assert re.match(rb"/\*\*\s*\n\* plotly\.js \(basic - minified\) v" + PIN["version"].encode(), bundle().script)


# Packing gives back what went in.

FINITE = st.floats(-180, 180, width=32)


def unpacked(text: str) -> tuple[object, bytes]:
    """Header and array bytes of a packed block, read as the page's script does."""
    raw = gzip.decompress(base64.b64decode(text))
    size = int.from_bytes(raw[:4], "little")
    return json.loads(raw[4 : 4 + size]), raw[4 + size :]


def integers(place: dict, raw: bytes, dtype: str) -> np.ndarray:
    """The stored integers of one array."""
    width = np.dtype(dtype).itemsize
    parts = np.frombuffer(raw[place["o"] : place["o"] + width * place["n"]], np.uint8).reshape(width, place["n"])
    zigzag = np.ascontiguousarray(parts.T).view(dtype.replace("i", "u")).ravel()
    return np.cumsum((zigzag >> 1).astype(dtype) ^ -(zigzag & 1).astype(dtype), dtype=dtype)


@given(hnp.arrays(np.float64, st.integers(1, 300), elements=FINITE | st.just(np.nan)))
def test_values_come_back_within_half_a_step(y):
    store = ArrayPacker()
    place = store.values(y, 0.01)
    _, raw = unpacked(store.pack({}))
    whole = integers(place, raw, "<i2")
    assert np.array_equal(whole == -32768, np.isnan(y))
    good = ~np.isnan(y)
    assert np.all(np.abs(whole[good] * place["s"] - y[good]) <= 0.5001 * place["s"])
    assert place["s"] == 0.01


@pytest.mark.parametrize("size", [1e-4, 1e-3, 1.0, 5000.0, 1e9])
def test_the_step_grows_with_the_range(size):
    store = ArrayPacker()
    y = size * np.linspace(-1, 1, 101)
    place = store.values(y)
    whole = integers(place, unpacked(store.pack({}))[1], "<i2")
    assert np.max(np.abs(whole * place["s"] - y)) <= 0.51 * place["s"]
    assert place["s"] < size / 16000


def test_times_of_a_long_log_keep_a_tenth_of_a_millisecond():
    store = ArrayPacker()
    t = np.arange(0, 6 * 3600, 0.25) + 0.00012
    place = store.times(t)
    back = integers(place, unpacked(store.pack({}))[1], "<i4") * place["s"]
    assert np.max(np.abs(back - t)) <= 0.51e-4


def test_equal_arrays_are_stored_once():
    store = ArrayPacker()
    t = np.arange(1000) * 0.004
    assert store.times(t) == store.times(t.copy())
    assert len(unpacked(store.pack({}))[1]) == 4000


def test_the_same_input_gives_the_same_bytes():
    def block():
        store = ArrayPacker()
        store.values(np.sin(np.arange(1000)), 0.01)
        return store.pack({"a": 1})

    assert block() == block()
