"""Threads of the linear algebra under numpy."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from threadpoolctl import ThreadpoolController


def one_blas_thread() -> Any:
    """Return a context in which BLAS has one thread.

    Fits are many products of small matrices: threads wait for each other longer than they work, and
    where other processes run, twenty times as long.

    Examples
    --------
    >>> with one_blas_thread():
    ...     all(pool["num_threads"] == 1 for pool in _controller().select(user_api="blas").info())
    True
    """
    return _controller().limit(limits=1, user_api="blas")


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    # it takes milliseconds to look through the libraries that are loaded
    return ThreadpoolController()
