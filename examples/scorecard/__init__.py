"""How good the diagnosis is: `python -m examples.scorecard`."""

import sys
from pathlib import Path

# examples.scorecard for Python, scorecard for pytest: the neighbours are the same either way
_EXAMPLES = str(Path(__file__).resolve().parents[1])
if _EXAMPLES not in sys.path:
    sys.path.insert(0, _EXAMPLES)
