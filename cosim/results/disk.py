"""A file on a disk that may become full, for HDF5, which does not survive that: it would end the process."""

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

Answer = TypeVar("Answer")


class DiskFile(io.FileIO):
    """A file whose space is reserved when it is opened; where the disk fails later, what is written is lost in silence.

    error: the first failure, for whoever closes it. Raises OSError where there is no room for `size` bytes.
    """

    def __init__(self, path: Path, size: int) -> None:
        super().__init__(path, "w+b")
        self.error: OSError | None = None
        self.end = 0  # of what was written; the reserved space does not count
        if hasattr(os, "posix_fallocate") and size > 0:
            try:
                os.posix_fallocate(self.fileno(), 0, size)
            except OSError:
                self.close()
                raise

    def _tried(self, action: Callable[[], Answer], instead: Answer) -> Answer:
        if self.error is None:
            try:
                return action()
            except OSError as error:
                self.error = error
        return instead

    def write(self, data: Any, /) -> int:
        """Write all of it."""
        view, done = memoryview(data).cast("B"), 0
        self.end = max(self.end, self.tell() + len(view))
        while done < len(view):
            rest = view[done:]
            done += self._tried(lambda rest=rest: super(DiskFile, self).write(rest) or 0, len(rest))
        return done

    def truncate(self, size: int | None = None, /) -> int:
        """As any file does."""
        self.end: int = self.tell() if size is None else size
        return self._tried(lambda: super(DiskFile, self).truncate(size), size or 0)

    def seek(self, offset: int, whence: int = os.SEEK_SET, /) -> int:
        """As any file does."""
        return super().seek(self.end + offset) if whence == os.SEEK_END else super().seek(offset, whence)

    def readinto(self, buffer: Any, /) -> int:
        """Read; nothing is zeros."""
        view = memoryview(buffer).cast("B")
        found = self._tried(lambda: super(DiskFile, self).readinto(view) or 0, 0)
        view[found:] = bytes(len(view) - found)
        return len(view)
