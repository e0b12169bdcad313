"""Decrypt PX4's encrypted ULogs (``.ulge``) with the vehicle's private key.

Layout and algorithms: PX4's guide, "Log Encryption". A header of 22 bytes holds the sizes of the stream's key, wrapped
by RSA (OAEP, SHA-256), and of its nonce; the log follows in XChaCha20. Up to PX4 1.15 header, key and nonce are a file
of their own (``.ulgk``) beside the log (``.ulgc``).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import LogUnreadable, LogUnusable, UsageError
from attlog.formats.file_bytes import read_file_bytes
from attlog.formats.ulog.layout import ENCRYPTED_MAGIC, KEY_FILE_MAGIC

Bytes = NDArray[np.uint8]

# Environment variable with the private key's file; ``--key`` sets it for the process and its children.
KEY_VARIABLE = "ATTLOG_KEY"
_GIVEN_KEY: ContextVar[Path | None] = ContextVar("given", default=None)
ENCRYPTED_HEADER, ENCRYPTED_VERSION, RSA_OAEP = struct.Struct("<7sBQBBHH"), 1, 4
# An RSA key of 16,384 bits wraps into 2,048 bytes; larger sizes are damage.
MAX_KEY_BYTES = 1 << 13


@contextmanager
def using_key(key: str | Path | None) -> Iterator[None]:
    """Decrypt with this private key within the block, with None by the environment's key."""
    token = _GIVEN_KEY.set(None if key is None else Path(key))
    try:
        yield
    finally:
        _GIVEN_KEY.reset(token)


def is_encrypted(head: bytes) -> bool:
    """Return whether a file is an encrypted ULog or its key file."""
    return head.startswith((ENCRYPTED_MAGIC, KEY_FILE_MAGIC))


def decrypt(path: Path, data: Bytes) -> Bytes:
    """Decrypt a log, a truncated one as far as possible.

    UsageError for a missing or invalid key or a missing package; LogUnreadable if a file cannot be opened; LogUnusable
    for a damaged header or another vehicle's key.
    """
    named = _GIVEN_KEY.get() or os.environ.get(KEY_VARIABLE, "")
    if not named:
        raise LogUnusable(
            f"{path}: this ULog is encrypted; give the vehicle's private key: --key FILE.pem (Python: key=)"
        )
    head = data[: ENCRYPTED_HEADER.size].tobytes()
    if len(head) < ENCRYPTED_HEADER.size:
        raise LogUnusable(f"{path}: ends within the header of an encrypted ULog")
    magic, version, _, algorithm, _, key_size, nonce_size = ENCRYPTED_HEADER.unpack(head)
    if version != ENCRYPTED_VERSION or algorithm != RSA_OAEP:
        raise LogUnusable(f"{path}: encrypted in a way that is not known (version {version}, algorithm {algorithm})")
    begin = ENCRYPTED_HEADER.size + key_size + nonce_size
    if not (0 < key_size <= MAX_KEY_BYTES and nonce_size in (8, 12, 24) and begin <= len(data)):
        raise LogUnusable(f"{path}: the header of this encrypted ULog is damaged")
    wrapped, nonce = (
        data[ENCRYPTED_HEADER.size : ENCRYPTED_HEADER.size + key_size].tobytes(),
        data[begin - nonce_size : begin].tobytes(),
    )
    key = _unwrap_key(path, Path(named), wrapped)
    content = data[begin:] if magic == ENCRYPTED_MAGIC else _log_beside(path)
    from Crypto.Cipher import ChaCha20

    try:
        cipher = ChaCha20.new(key=key, nonce=nonce)
    except ValueError as error:
        raise LogUnusable(f"{path}: the header of this encrypted ULog is damaged ({error})") from None
    plain = bytearray(len(content))
    cipher.decrypt(content.data, output=plain)
    return np.frombuffer(plain, np.uint8)


def has_key() -> bool:
    """Return whether the environment names a private key."""
    return bool(os.environ.get(KEY_VARIABLE))


def _log_beside(path: Path) -> Bytes:
    """Return the path of the log that belongs to a separate key file (older firmware)."""
    log = path.with_suffix(".ulgc")
    if not log.exists():
        raise LogUnreadable(f"{path}: is the key of an encrypted ULog; put {log.name} beside it, both unpacked")
    return read_file_bytes(log)


def _unwrap_key(path: Path, key_file: Path, wrapped: bytes) -> bytes:
    """Return the key of the stream cipher. Errors as for :func:`decrypt`."""
    try:
        from Crypto.Cipher import PKCS1_OAEP
        from Crypto.Hash import SHA256
        from Crypto.PublicKey import RSA
    except ImportError:
        raise UsageError(
            'an encrypted ULog needs pycryptodome: pip install pycryptodome, or pip install ".[encrypted]" in the '
            "source folder"
        ) from None
    try:
        text = key_file.read_bytes()
    except OSError as error:
        raise LogUnreadable(
            f"{key_file.name} (--key, {KEY_VARIABLE}): the key cannot be read ({error.strerror or error})"
        ) from None
    try:
        private = RSA.import_key(text)
    except (ValueError, IndexError, TypeError):
        locked = " (one with a passphrase has to be unlocked first)" if b"ENCRYPTED" in text else ""
        raise UsageError(f"{key_file.name}: no private RSA key in PEM or DER form{locked}") from None
    if not private.has_private():
        raise UsageError(f"{key_file.name}: is a public key; the log opens with the private one")
    try:
        return PKCS1_OAEP.new(private, SHA256).decrypt(wrapped)
    except (ValueError, TypeError):
        raise LogUnusable(f"{path}: {key_file.name} is not the key of the vehicle that wrote it") from None
