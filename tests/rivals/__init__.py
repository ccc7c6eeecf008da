"""The diagnosis beside other tools on the same blind cases: `python -m tests.rivals`."""

import sys
from pathlib import Path

# run as tests.rivals and imported by pytest as rivals: the neighbours are the same either way
_TESTS = str(Path(__file__).resolve().parents[1])
if _TESTS not in sys.path:
    sys.path.insert(0, _TESTS)
