"""Calls of slow functions outside the thread that serves the sockets."""

import threading
from collections.abc import Callable
from typing import TypeVar

import eventlet

Result = TypeVar("Result")


def call_in_thread(function: Callable[..., Result], *arguments: object) -> Result:
    """Call a function in a new thread; return its result, or raise its exception.

    The calling green thread waits, while all other green threads run.

    >>> call_in_thread(max, 2, 3)
    3
    """
    results: list[Result] = []
    failures: list[BaseException] = []

    def call() -> None:
        try:
            results.append(function(*arguments))
        except BaseException as error:
            failures.append(error)

    # Not eventlet's tpool, which can hang when the process ends (eventlet #989).
    thread = threading.Thread(target=call, daemon=True)
    thread.start()
    while thread.is_alive():
        eventlet.sleep(0.02)
    if failures:
        raise failures[0]
    return results[0]
