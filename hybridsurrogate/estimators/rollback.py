"""A fit that fails leaves no half of itself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def restored_on_failure(estimator: Any) -> Iterator[None]:
    """Give an estimator back all that it was where the block does not end well.

    A first fit that fails then leaves it not fitted, a later one leaves the fit before.
    """
    before = dict(vars(estimator))
    try:
        yield
    except BaseException:  # an interrupt, too, comes halfway
        vars(estimator).clear()
        vars(estimator).update(before)
        raise
