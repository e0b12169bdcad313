"""An encrypted ULog opens with the vehicle's private key, and says what is wrong where it does not.

Encrypted here as PX4's guide ("Log Encryption") says, with a library that the reader's own test could not bend.
"""

from __future__ import annotations

import gzip
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog as library
from attlog import formats
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, UsageError
from attlog.formats.ulog.encrypted import KEY_VARIABLE

pytest.importorskip("Crypto", reason="needs pycryptodome")
from Crypto.Cipher import PKCS1_OAEP, ChaCha20
from Crypto.Hash import SHA256
from Crypto.PublicKey import RSA

from tests.conftest import SAMPLES

PLAIN = SAMPLES / "px4_hover.ulg"
PRIVATE = RSA.generate(2048)
NONCE, STREAM_KEY = bytes(range(24)), bytes(range(32, 64))


def header(
    magic: bytes = b"ULogEnc", version: int = 1, algorithm: int = 4, sizes: tuple[int, int] = (256, 24)
) -> bytes:
    """The first 22 bytes of an encrypted log."""
    return magic + struct.pack("<BQBBHH", version, 1_700_000_000, algorithm, 0, *sizes)


def wrapped() -> bytes:
    """The stream's key, locked with the vehicle's public one, and the nonce."""
    return PKCS1_OAEP.new(PRIVATE.public_key(), SHA256).encrypt(STREAM_KEY) + NONCE


def stream(plain: bytes) -> bytes:
    """The log itself."""
    return ChaCha20.new(key=STREAM_KEY, nonce=NONCE).encrypt(plain)


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The private key in a file that the environment names."""
    path = tmp_path / "vehicle.pem"
    path.write_bytes(PRIVATE.export_key())
    monkeypatch.setenv(KEY_VARIABLE, str(path))
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A sample, encrypted."""
    path = tmp_path / "flight.ulge"
    path.write_bytes(header() + wrapped() + stream(PLAIN.read_bytes()))
    return path


def same(a: formats.Messages, b: formats.Messages) -> None:
    assert list(a) == list(b)
    for name in list(b)[:8]:
        for field in b[name].fields:
            np.testing.assert_array_equal(a[name][field], b[name][field])


def test_it_holds_what_the_plain_one_holds(log: Path, key: Path) -> None:
    same(formats.open(log), formats.open(PLAIN))


def test_also_in_a_gzip_file(log: Path, key: Path, tmp_path: Path) -> None:
    packed = tmp_path / "flight.ulge.gz"
    packed.write_bytes(gzip.compress(log.read_bytes(), 1))
    same(formats.open(packed), formats.open(PLAIN))


def test_the_key_file_of_an_older_firmware_leads_to_the_log_beside_it(key: Path, tmp_path: Path) -> None:
    (tmp_path / "old.ulgk").write_bytes(header(b"ULogKey") + wrapped())
    (tmp_path / "old.ulgc").write_bytes(stream(PLAIN.read_bytes()))
    same(formats.open(tmp_path / "old.ulgk"), formats.open(PLAIN))
    (tmp_path / "old.ulgc").unlink()
    with pytest.raises(LogUnreadable, match=r"put old\.ulgc beside it"):
        formats.open(tmp_path / "old.ulgk")


def test_of_one_that_was_cut_the_beginning_is_read(log: Path, key: Path) -> None:
    os.truncate(log, log.stat().st_size // 2)
    half, whole = formats.open(log), formats.open(PLAIN)
    name = ("sensor_combined", 0)
    assert 0.3 < len(half[name]) / len(whole[name]) < 0.7
    np.testing.assert_array_equal(half[name]["timestamp"], whole[name]["timestamp"][: len(half[name])])


def test_without_a_key_it_says_how_to_give_one(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    with pytest.raises(LogUnusable, match=r"encrypted.*--key"):
        formats.open(log)


def test_from_python_a_key_is_given_to_the_call_and_to_no_other(
    log: Path, key: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(KEY_VARIABLE)
    read = library.read(log, key=key)
    np.testing.assert_array_equal(read.imus[0].gyro.x, library.read(PLAIN).imus[0].gyro.x)
    with pytest.raises(LogUnusable, match="key="):
        library.read(log)
    monkeypatch.setenv(KEY_VARIABLE, str(key.with_name("another.pem")))
    same(formats.open(log, key=str(key)), formats.open(PLAIN))


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        (RSA.generate(1024).export_key(), LogUnusable, "not the key of the vehicle"),
        (PRIVATE.public_key().export_key(), UsageError, "public key"),
        (PRIVATE.export_key(passphrase="secret"), UsageError, "passphrase"),
        (b"no key at all", UsageError, "no private RSA key"),
        (b"", UsageError, "no private RSA key"),
    ],
)
def test_what_is_wrong_with_a_key_is_said(
    log: Path, key: Path, content: bytes, error: type[AttlogError], words: str
) -> None:
    key.write_bytes(content)
    with pytest.raises(error, match=words):
        formats.open(log)


def test_a_key_that_is_not_there_is_said(log: Path, key: Path) -> None:
    key.unlink()
    with pytest.raises(LogUnreadable, match=r"vehicle\.pem"):
        formats.open(log)


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (header()[:15], "ends within the header"),
        (header(version=2), "not known"),
        (header(algorithm=3), "not known"),
        (header(sizes=(0, 24)), "damaged"),
        (header(sizes=(256, 17)), "damaged"),
        (header(sizes=(60_000, 24)), "damaged"),
        (header(), "damaged"),
    ],
)
def test_a_damaged_header_is_said(tmp_path: Path, key: Path, head: bytes, words: str) -> None:
    path = tmp_path / "broken.ulge"
    path.write_bytes(head)
    with pytest.raises(LogUnusable, match=words):
        formats.open(path)


def test_bytes_that_open_into_nonsense_are_no_log(tmp_path: Path, key: Path) -> None:
    path = tmp_path / "nonsense.ulge"
    path.write_bytes(header() + wrapped() + bytes(4096))
    with pytest.raises(AttlogError, match="no ULog header"):
        formats.open(path)


@pytest.mark.slow
def test_the_command_takes_the_key_before_and_after_it(
    attlog: Any, log: Path, key: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "")
    assert attlog("info", str(log)).code == 65
    assert "px4" in attlog("info", str(log), "--key", str(key)).out.lower()
    monkeypatch.setenv(KEY_VARIABLE, "")
    assert attlog("--key", str(key), "info", str(log)).code == 0


@pytest.mark.slow
def test_no_result_and_no_sentence_tells_where_the_key_lies(
    attlog: Any, log: Path, key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Results and the pages of a batch are passed on."""
    hidden = tmp_path / "vault"
    hidden.mkdir()
    secret = key.rename(hidden / "vehicle.pem")
    more = ("--estimators", "gyro", "--reference", "onboard", "-q", "-o", tmp_path / "out")
    for k, words in enumerate([("--key", secret), (f"--key={secret}",)]):
        monkeypatch.setenv(KEY_VARIABLE, "")
        assert attlog("analyze", log, *words, *more).code == 0, k
        for suffix in ("html", "json"):
            assert b"vault" not in (tmp_path / "out" / f"flight.ulge.{suffix}").read_bytes()
    secret.write_bytes(b"no key at all")
    with pytest.raises(UsageError) as told:
        formats.open(log)
    assert "vehicle.pem" in str(told.value)
    assert "vault" not in str(told.value)


@pytest.mark.slow
def test_a_batch_that_goes_on_with_a_key_reads_what_was_locked_before(
    attlog: Any, log: Path, key: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It counted them as failed before, and ended with 0."""
    again = ("batch", log, "--estimators", "gyro", "--reference", "onboard", "--resume", "-o", tmp_path / "out")
    monkeypatch.setenv(KEY_VARIABLE, "")
    assert attlog(*again).code == 65
    assert "1 failed before" in attlog(*again).out
    done = attlog(*again, "--key", key)
    assert (done.code, "1 report" in done.out) == (0, True)
    monkeypatch.setenv(KEY_VARIABLE, "")
    assert "1 done before" in attlog(*again).out
