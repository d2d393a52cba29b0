"""Signal handlers of the command line for Ctrl-C and SIGTERM."""

import signal


class _Interrupt(KeyboardInterrupt):
    """Ctrl-C. If a plain KeyboardInterrupt leaves exec("..."), which imports call, Python later ends with a signal
    instead of the exit code; it does not do so for a subclass."""


def _interrupt(number: int, frame: object) -> None:
    raise _Interrupt


def answer_signals() -> list[int]:
    """Raise _Interrupt at Ctrl-C, and handle SIGTERM like Ctrl-C. The returned list receives the number of a
    SIGTERM."""
    received: list[int] = []

    def end(number: int, frame: object) -> None:
        received.append(number)
        interrupt = signal.getsignal(signal.SIGINT)
        # not callable if Ctrl-C is ignored, as in a background job of a shell
        (interrupt if callable(interrupt) else _interrupt)(signal.SIGINT, None)

    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    signal.signal(signal.SIGTERM, end)
    return received


def ignore_signals() -> None:
    """Ignore Ctrl-C and SIGTERM from now on."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
