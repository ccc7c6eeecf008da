"""Types of arguments and results."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating[Any]]
# a frozen scipy.stats distribution; scipy has no public type for it
Prior = Any
