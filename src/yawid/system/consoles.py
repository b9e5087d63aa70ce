"""Consoles: one of Windows shows escape sequences (colours, the live screen) only when set to."""

import os
import sys
from typing import Final

_OUT_AND_ERR: Final = (-11, -12)  # STD_OUTPUT_HANDLE, STD_ERROR_HANDLE
_ESCAPES: Final = 0x0004  # ENABLE_VIRTUAL_TERMINAL_PROCESSING, in Windows 10 since 1607


def show_escapes() -> None:
    """Have this process's consoles show escape sequences; where one cannot, print none."""
    if sys.platform == "win32":
        import ctypes

        kernel, mode = ctypes.windll.kernel32, ctypes.c_ulong()
        for number in _OUT_AND_ERR:
            handle = kernel.GetStdHandle(number)
            is_console = kernel.GetConsoleMode(handle, ctypes.byref(mode))
            if is_console and not kernel.SetConsoleMode(handle, mode.value | _ESCAPES):
                os.environ["TERM"] = "dumb"
