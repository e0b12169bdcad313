"""Templates are compiled once on a machine; the scripts of a page declare no name twice."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import jinja2
import pytest

from attlog import compare
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


def declared(script: str) -> list[str]:
    """The names that a script declares outside functions."""
    names = re.findall(r"^(?:async )?(?:function\*?|class) +(\w+)", script, re.MULTILINE)
    for line in re.findall(r"^(?:const|let|var) (.*)", script, re.MULTILINE):
        flat, deep = "", 0
        for sign in line.replace("=>", ""):
            deep += (sign in "([{") - (sign in ")]}")
            flat += sign if deep == 0 else ""
        names += [part.partition("=")[0].strip() for part in flat.split(";")[0].split(",")]
    return [name for name in names if name]


def test_no_name_is_declared_by_two_scripts_of_a_page() -> None:
    """All scripts of a page share one scope, where a second const of a name ends the page's script."""
    own = {path.stem: path.read_text() for path in (Path(compare.__file__).parent / "web").glob("*.js")}
    common = [name for file in shell.SCRIPTS for name in declared((shell.WEB / file).read_text())]
    assert len(common) > 100
    for script in ("", *own.values()):
        names = Counter([*common, *declared(script)])
        assert [name for name, n in names.items() if n > 1] == []


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
