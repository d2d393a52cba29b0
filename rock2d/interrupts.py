"""Signal handlers of the command line for Ctrl-C and SIGTERM."""

import os
import signal
import sys
import threading
from types import FrameType


class _Interrupt(KeyboardInterrupt):
    """Ctrl-C. If a plain KeyboardInterrupt leaves exec("..."), which imports call, Python later ends with a signal
    instead of the exit code; it does not do so for a subclass."""

    number: int  # of the signal


def _interrupt(number: int, frame: FrameType | None) -> None:
    if _in_machine_code(frame):
        return _later(number)
    error = _Interrupt()
    error.number = number
    raise error


def _in_machine_code(frame: FrameType | None) -> bool:
    """Whether compiled code called this Python code. The compiled code does not expect an exception here: it goes on,
    and ends with a SystemError."""
    while frame is not None and frame.f_code.co_name != "_numba_unpickle":
        frame = frame.f_back
    return frame is not None


def _later(number: int) -> None:
    threading.Timer(0.05, os.kill, (os.getpid(), number)).start()


def _again(lost: "sys.UnraisableHookArgs") -> None:
    """Python drops an exception in a destructor or a callback: interrupt again, a little later."""
    if isinstance(lost.exc_value, _Interrupt):
        _later(lost.exc_value.number)
    else:
        sys.__unraisablehook__(lost)


def answer_signals() -> list[int]:
    """Raise _Interrupt at Ctrl-C, and handle SIGTERM like Ctrl-C. The returned list receives the number of a
    SIGTERM."""
    received: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        received.append(number)
        interrupt = signal.getsignal(signal.SIGINT)
        # not callable if Ctrl-C is ignored, as in a background job of a shell
        (interrupt if callable(interrupt) else _interrupt)(number, frame)

    sys.unraisablehook = _again
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, end)
    return received


def ignore_signals() -> None:
    """Ignore Ctrl-C and SIGTERM from now on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
