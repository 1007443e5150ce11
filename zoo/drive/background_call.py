"""What takes long is done beside the one thread that serves the sockets."""

import threading
from collections.abc import Callable
from typing import TypeVar

import eventlet

Result = TypeVar("Result")


def beside(function: Callable[..., Result], *arguments: object) -> Result:
    """What `function` returns or raises, called in a thread of its own. The green thread that asks
    waits, and all others go on.

    >>> beside(max, 2, 3)
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
