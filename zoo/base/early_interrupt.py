"""Ctrl-C while Python imports a command's modules: one line instead of a traceback."""

import os
import signal
import sys

AGAIN_S = 0.05

_module = ""  # that this process runs


def stop_quietly(package: str) -> None:
    """Let Ctrl-C end `python -m PACKAGE...` in one line, if no other handler is set."""
    given = sys.orig_argv
    module = given[given.index("-m") + 1] if "-m" in given[:-1] else ""
    importing = sys.argv[:1] == ["-m"]  # its value while `python -m` imports the command
    if importing and module.partition(".")[0] == package:
        stop_in_one_line(module)


def stop_in_one_line(module: str) -> None:
    """Let Ctrl-C end this process in one line that names the module, if no other handler is set."""
    global _module
    _module = module
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)


def raise_again() -> None:
    """Let Ctrl-C raise KeyboardInterrupt again, which commands handle."""
    if signal.getsignal(signal.SIGINT) is _stop:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if sys.platform == "win32":  # where a process can send no Ctrl-C to one other process
        signal.signal(signal.SIGBREAK, signal.default_int_handler)
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _interrupt_again


def _interrupt_again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Deliver a Ctrl-C again that arrived in a finalizer or callback, which cannot raise it."""
    if unraisable.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(unraisable)
        return
    import threading  # late: nothing slow comes before `stop_quietly`

    if hasattr(signal, "pthread_kill"):
        # To the main thread: a signal to the timer's would not wake it from a system call.
        main = threading.main_thread().ident
        timer = threading.Timer(AGAIN_S, signal.pthread_kill, [main, signal.SIGINT])
    else:  # Windows, where a signal of any thread wakes the main thread
        timer = threading.Timer(AGAIN_S, signal.raise_signal, [signal.SIGINT])
    timer.daemon = True
    timer.start()


def _stop(*_: object) -> None:
    line = f"{_module}: stopped\n"
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, line.encode())
    os._exit(130)
