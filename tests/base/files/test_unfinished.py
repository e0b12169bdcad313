"""What killed processes left of files is removed, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.files.output import KEPT, STAGE, remove_unfinished

HEX = "0123456789ab"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in (
        f".a.html.{HEX}",
        f".{'b' * KEPT}.{HEX}",
        f".c.html.{HEX}0",
        ".hidden",
        f"a.html.{HEX}",
        ".a.html.0123",
    ):
        (tmp_path / name).write_text("x")
    (tmp_path / f".{STAGE}.{HEX}" / "inner").mkdir(parents=True)
    (tmp_path / f".other.{HEX}").mkdir()
    return tmp_path


def left(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_without_names_the_unfinished_of_any_file_goes(folder: Path) -> None:
    before = left(folder)
    remove_unfinished(folder)
    assert before - left(folder) == {f".a.html.{HEX}", f".{'b' * KEPT}.{HEX}", f".{STAGE}.{HEX}"}


def test_with_names_only_that_of_these_files_goes_by_the_letters_that_are_kept(folder: Path) -> None:
    before = left(folder)
    remove_unfinished(folder, "b" * (KEPT + 9), "z.html")
    assert before - left(folder) == {f".{'b' * KEPT}.{HEX}", f".{STAGE}.{HEX}"}


def test_a_link_to_a_folder_is_not_followed(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").write_text("x")
    (tmp_path / f".{STAGE}.{HEX}").symlink_to(kept)
    remove_unfinished(tmp_path)
    assert (kept / "file").exists()
