"""How good the diagnosis is: `python -m tests.scorecard`."""

import sys
from pathlib import Path

# run as tests.scorecard and imported by pytest as scorecard: the neighbours are the same either way
_TESTS = str(Path(__file__).resolve().parents[1])
if _TESTS not in sys.path:
    sys.path.insert(0, _TESTS)
