"""What a chunk's file holds: large plain chunks mapped into memory, as many as a process may map, and others read."""

from __future__ import annotations

import errno
import mmap
import os
import resource
import weakref

from isosample.errors import CacheError
from isosample.surfaces.plain_chunks import PLAIN_MAGIC

MAPPED_BYTES = 1 << 14  # plain chunks of this size or more are mapped
MOST_MAPPED = 20_000  # at a time: a process may have some 65 thousand mappings, and needs them for memory too
DESCRIPTOR_SHARE = (
    2  # mappings keep a descriptor each: at most one in so many of those that a process may have
)
NO_DESCRIPTOR = (errno.EMFILE, errno.ENFILE)
NOT_MAPPABLE = (*NO_DESCRIPTOR, errno.ENOMEM, errno.ENODEV)  # what is then read instead
MAPPED: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()  # by all stores, and still in use


class TooManyFilesError(CacheError):
    """A chunk cannot be opened because too many files are open."""


def chunk_content(path: str) -> tuple[bytes | mmap.mmap, float]:
    """Return what a chunk's file holds, and when it was changed [s since 1970].

    Raises
    ------
    OSError
        If it is absent or cannot be read.
    TooManyFilesError
        If it cannot be opened because too many files are open; that says nothing about the chunk.
    """
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        if error.errno not in NO_DESCRIPTOR:
            raise
        raise TooManyFilesError(
            f"{path} cannot be opened ({error.strerror}), which says nothing about the file. Let the process have "
            "more files open (`ulimit -n`) and run the same command again."
        ) from error
    try:
        state = os.fstat(file)
        size = state.st_size
        if size >= MAPPED_BYTES and os.pread(file, len(PLAIN_MAGIC), 0) == PLAIN_MAGIC:
            mapped = _mapped(file)
            if mapped is not None:
                return mapped, state.st_mtime
        data = os.read(file, size)
        while len(data) < size and (more := os.read(file, size - len(data))):
            data += more
        return data, state.st_mtime
    finally:
        os.close(file)


def _mapped(file: int) -> mmap.mmap | None:
    """Map a file for reading; None where no more may be mapped, or this one cannot be."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = MOST_MAPPED if limit == resource.RLIM_INFINITY else min(MOST_MAPPED, limit // DESCRIPTOR_SHARE)
    if len(MAPPED) >= most:
        return None
    try:
        mapped = mmap.mmap(file, 0, access=mmap.ACCESS_READ)
    except OSError as error:
        if error.errno not in NOT_MAPPABLE:
            raise
        return None
    MAPPED.add(mapped)
    return mapped
