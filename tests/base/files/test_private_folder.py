"""What is run again later lies where nobody else can put anything."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

from attlog.base.files.private_folder import private_folder, usable, version_of


@pytest.fixture
def homes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's cache and a temporary folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def test_the_users_cache_is_taken(homes: Path) -> None:
    found = private_folder("templates", "1")
    assert found == homes / "cache" / "attlog" / "templates" / "1"
    assert found.is_dir()


def test_else_a_temporary_folder_is_taken(homes: Path) -> None:
    (homes / "cache").write_text("no folder")
    found = private_folder("templates", "1")
    assert found is not None
    assert found.parent.parent == homes
    assert str(os.getuid()) in found.parent.name


def test_where_nothing_can_be_written_nothing_is_kept(homes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A container whose file system is read-only has no temporary folder at all, which Python tells by an error."""
    (homes / "cache").write_text("no folder")
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setattr("tempfile._candidate_tempdir_list", lambda: [str(homes / "cache" / "nowhere")])
    with pytest.raises(FileNotFoundError):
        tempfile.gettempdir()
    assert private_folder("templates", "1") is None


@pytest.mark.parametrize("open_to", [0o770, 0o707])
def test_a_folder_that_others_can_write_to_is_refused(tmp_path: Path, open_to: int) -> None:
    folder = tmp_path / "kind" / "version"
    assert usable(folder)
    folder.chmod(open_to)
    assert not usable(folder)


def test_a_folder_below_one_that_others_can_write_to_is_refused_unless_its_sticky_bit_is_set(tmp_path: Path) -> None:
    """Whoever may write there may put a folder of his own in the place of the user's."""
    shared = tmp_path / "shared"
    folder = shared / "cache" / "attlog" / "kernels" / "1"
    assert usable(folder)
    for mode, found in [(0o777, False), (0o1777, True), (0o757, False), (0o755, True)]:
        shared.chmod(mode)
        assert usable(folder) == found, oct(mode)
    shared.chmod(0o777)
    (tmp_path / "link").symlink_to(shared)
    assert not usable(tmp_path / "link" / "cache" / "attlog" / "kernels" / "1")


@pytest.mark.parametrize("open_to", [0o770, 0o707])
def test_the_folder_above_is_closed_to_others(tmp_path: Path, open_to: int) -> None:
    folder = tmp_path / "kind" / "version"
    assert usable(folder)
    folder.parent.chmod(open_to)
    assert usable(folder)
    assert folder.parent.stat().st_mode & 0o22 == 0


@pytest.mark.parametrize("umask", [0o002, 0o000])
def test_whatever_the_umask_the_users_cache_is_taken(homes: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        found = private_folder("templates", "1")
    finally:
        os.umask(before)
    assert found == homes / "cache" / "attlog" / "templates" / "1"


def test_none_is_found_where_nothing_can_be_written(homes: Path) -> None:
    (homes / "cache").write_text("no folder")
    (homes / f"attlog-templates-{os.getuid()}").write_text("no folder")
    assert private_folder("templates", "1") is None


@pytest.mark.parametrize("package", ["numba", "jinja2", "numpy"])
def test_the_version_of_a_package_is_the_installed_one(package: str) -> None:
    from importlib.metadata import version

    assert version_of(package) == version(package)


def test_a_package_that_is_not_there_has_no_version() -> None:
    assert version_of("no_such_package") == "none"
