# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Errors of bags, each in one line: what was given, what is allowed, what to do."""

import errno

from atpid_common.errors import InputError


class BagError(InputError):
    """A bag that cannot be written or read."""


class MessageError(InputError):
    """A message that cannot be recorded; the recording goes on without it."""


class TypeUnknownError(BagError):
    """A message type whose definition is not installed."""


def in_words(error: OSError) -> str:
    """Return the reason of the operating system, and what to do about it."""
    known = {
        errno.ENOSPC: "the disk is full: free some space",
        errno.EDQUOT: "the disk quota is used up: free some space",
        errno.EFBIG: "the file grew beyond the allowed size: raise the limit (ulimit -f)",
        errno.EACCES: "no permission to write there: choose another folder",
        errno.EPERM: "no permission to write there: choose another folder",
        errno.EROFS: "the file system is read-only: choose another folder",
        errno.ENOTDIR: "a part of the path is a file, not a folder: choose another folder",
        errno.EIO: "the disk reports an error: choose another disk",
    }
    return known.get(error.errno or 0, (error.strerror or str(error)).lower())
