"""Calls to the operating system that fail when a test wants them to: the n-th of its kind on files below a folder.

The entry of the C library's function is overwritten by a jump to a Python function, so that SQLite's calls are caught
as well as Python's own. For 64-bit Intel and ARM processors on Linux.
"""

import atexit
import ctypes
import errno
import mmap
import os
import platform
import struct
import sys
from collections.abc import Callable
from typing import Any

_C = ctypes.CDLL(None, use_errno=True)
_INT, _LONG, _TEXT, _ANY = ctypes.c_int, ctypes.c_long, ctypes.c_char_p, ctypes.c_void_p
_NUMBERS = {  # of system calls
    "x86_64": {"openat": 257, "write": 1, "pwrite64": 18, "fsync": 74, "fdatasync": 75, "renameat": 264},
    "aarch64": {"openat": 56, "write": 64, "pwrite64": 68, "fsync": 82, "fdatasync": 83, "renameat": 38},
}[platform.machine()]
_HERE = -100  # AT_FDCWD
_KINDS = {
    "open": (("open64", (_TEXT, _INT, _INT), "openat"), ("open", (_TEXT, _INT, _INT), "openat")),
    "write": (("write", (_INT, _ANY, _LONG), "write"), ("pwrite64", (_INT, _ANY, _LONG, _LONG), "pwrite64")),
    "fsync": (("fsync", (_INT,), "fsync"), ("fdatasync", (_INT,), "fdatasync")),
    "rename": (("rename", (_TEXT, _TEXT), "renameat"),),
}
_KEPT: list[Any] = []  # callbacks that the C library now jumps to


def fail(kind: str, code: int, number: int, folder: str) -> None:
    """Makes the call with this number fail, and with a full disk all after it; without a number, counts them.

    Args:
        kind: "open", "write", "fsync" or "rename".
        code: error number, such as `errno.ENOSPC`.
        number: of the first call that fails, from 1; 0 to print at the end how many there were.
        folder: calls on other files are not counted.
    """
    count = [0]

    def failing(path: str) -> bool:
        if not path.startswith(folder) or path.endswith(("acknowledged", "begun")):
            return False
        count[0] += 1
        return count[0] >= number > 0 if code == errno.ENOSPC else count[0] == number

    if not number:
        atexit.register(lambda: print(count[0], file=sys.stderr))

    for name, types, system in _KINDS[kind]:
        _replace(name, types, _instead(system, code, failing))


def _instead(system: str, code: int, failing: Callable[[str], bool]) -> Callable[..., int]:
    """The system call itself, unless it is to fail."""
    _C.syscall.restype = _LONG

    def call(*arguments: Any) -> int:
        first = arguments[0]
        if failing(first.decode() if isinstance(first, bytes) else _name(first)):
            ctypes.set_errno(code)
            return -1
        given = [_HERE, *arguments] if system == "openat" else arguments
        given = [_HERE, arguments[0], _HERE, arguments[1]] if system == "renameat" else given
        wide = [_TEXT(x) if isinstance(x, bytes) else _LONG(x or 0) for x in given]
        result: int = _C.syscall(_LONG(_NUMBERS[system]), *wide)
        return result

    return call


def _name(descriptor: int) -> str:
    try:
        return os.readlink(f"/proc/self/fd/{descriptor}")
    except OSError:
        return ""


def _replace(name: str, types: tuple[Any, ...], function: Callable[..., int]) -> None:
    callback = ctypes.CFUNCTYPE(_LONG, *types, use_errno=True)(function)
    _KEPT.append(callback)
    target = ctypes.cast(callback, _ANY).value
    if platform.machine() == "x86_64":
        jump = b"\x48\xb8" + struct.pack("<Q", target) + b"\xff\xe0"  # mov rax, target; jmp rax
    else:
        jump = struct.pack("<II", 0x58000050, 0xD61F0200) + struct.pack("<Q", target)  # ldr x16, 8; br x16
    entry = ctypes.cast(getattr(_C, name), _ANY).value
    assert entry is not None
    page = entry & -mmap.PAGESIZE
    assert _C.mprotect(_ANY(page), ctypes.c_size_t(2 * mmap.PAGESIZE), 7) == 0, os.strerror(ctypes.get_errno())
    ctypes.memmove(entry, jump, len(jump))
