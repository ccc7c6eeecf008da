"""A search that its user stops."""

from __future__ import annotations

from typing import Any


class InterruptedSearch(KeyboardInterrupt):
    """An interrupt on its way out, with what was finished when it came.

    Attributes
    ----------
    kept : Any
        The fits, then the `Search` made of them; None when nothing was finished.
    """

    def __init__(self, kept: Any) -> None:
        super().__init__("the search was interrupted")
        self.kept = kept
