"""Numbers that studies on blind cases and measured data computed, each with its commit and day.

They stand in one file, which the studies write: a reader sees how old a number is.
"""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

STUDIED: dict[str, dict[str, Any]] = json.loads(
    files("hybridsurrogate").joinpath("studied.json").read_text(encoding="utf-8")
)
