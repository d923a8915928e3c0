"""Set blocks of a disk aside for files that are still growing, so that several at once cannot fill it."""

import ctypes
import errno
import sys

from service.errors import InsufficientStorageError

KEEP_SIZE = 1
FULL = {errno.ENOSPC, errno.EDQUOT}


def set_aside(descriptor: int, size: int) -> bool:
    """Let the file system keep blocks for a file to grow to a size; the size it has now stays.

    They are given back when the file is removed or cut.

    Returns
    -------
    False when this file system cannot do it.

    Raises
    ------
    InsufficientStorageError
        It has not as many blocks.
    """
    if sys.platform != "linux" or size <= 0:
        return False
    library = ctypes.CDLL(None, use_errno=True)
    done = library.fallocate(descriptor, KEEP_SIZE, ctypes.c_longlong(0), ctypes.c_longlong(size))
    if done == 0:
        return True
    if ctypes.get_errno() in FULL:
        raise InsufficientStorageError("the disk of this service has no room for this; try again later")
    return False
