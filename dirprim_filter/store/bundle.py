"""A bundle: many small files as one, each with the mark that it had, so that one request fetches what many would.

A copy, never the truth: who reads it goes by the marks that the files have now, and of a bundle that is damaged, too
large or of another version nothing is used.
"""

from __future__ import annotations

import hashlib
import json

import zstandard

Marked = dict[str, tuple[str, bytes]]
"""By names of files: marks, which are others when contents are, and contents."""
VERSION = b"dirprim-bundle-1\n"
LARGEST = 1 << 28
"""Bytes of a bundle, packed or not: of some 300,000 logs."""


def bundled(files: Marked) -> bytes | None:
    """The bundle of some files; None where it would be too large."""
    held = {name: (mark, data.decode("latin-1")) for name, (mark, data) in sorted(files.items())}
    plain = json.dumps(held).encode()
    if len(plain) > LARGEST:
        return None
    packed = zstandard.compress(plain)
    return VERSION + hashlib.sha256(packed).digest() + packed


def unbundled(data: bytes) -> Marked:
    """The files of a bundle; none of what is no whole bundle of this version."""
    start = len(VERSION) + hashlib.sha256().digest_size
    packed = data[start:]
    if len(data) > LARGEST or data[:start] != VERSION + hashlib.sha256(packed).digest():
        return {}
    try:
        if not 0 < zstandard.frame_content_size(packed) <= LARGEST:
            return {}
        held = json.loads(zstandard.decompress(packed))
        return {name: (mark, text.encode("latin-1")) for name, (mark, text) in held.items()}
    except (zstandard.ZstdError, ValueError, TypeError, AttributeError):  # whole, but of another program
        return {}


def lacking(files: Marked, marks: dict[str, str]) -> set[str]:
    """Names of the files that are not among some, or have another mark, or none, now."""
    return {name for name, mark in marks.items() if not mark or name not in files or files[name][0] != mark}
