"""Templates are compiled once on a machine."""

from __future__ import annotations

from pathlib import Path

import jinja2
import pytest

from attlog.report import shell


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that compiled templates are kept in."""
    folder = tmp_path / "kept"
    folder.mkdir()
    monkeypatch.setattr(shell, "private_folder", lambda kind, version: folder)
    return folder


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with a template of its own."""
    folder = tmp_path / "web"
    folder.mkdir()
    (folder / "own.html").write_text("<p>{{ word|loud }}</p>")
    return folder


def filled(folder: Path) -> str:
    return shell.load_template("own.html", {"loud": str.upper}, folder).render(word="<hi>")


def test_a_template_is_compiled_once(kept: Path, own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert filled(own) == "<p>&lt;HI&gt;</p>"
    monkeypatch.setattr(jinja2.Environment, "compile", lambda *_, **__: pytest.fail("compiled again"))
    assert filled(own) == "<p>&lt;HI&gt;</p>"


def test_a_template_that_changed_is_compiled_again(kept: Path, own: Path) -> None:
    filled(own)
    (own / "own.html").write_text("<b>{{ word|loud }}</b>")
    assert filled(own) == "<b>&lt;HI&gt;</b>"


def test_a_damaged_file_is_made_again(kept: Path, own: Path) -> None:
    filled(own)
    (file,) = kept.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    assert filled(own) == "<p>&lt;HI&gt;</p>"
    assert file.read_bytes() == whole


def test_a_folder_that_cannot_be_written_is_no_error(kept: Path, own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept.rmdir()
    assert filled(own) == "<p>&lt;HI&gt;</p>"
    monkeypatch.setattr(shell, "private_folder", lambda kind, version: None)
    assert filled(own) == "<p>&lt;HI&gt;</p>"
