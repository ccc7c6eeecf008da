"""The diagnosis beside other tools on the same blind cases: `python -m examples.rivals`."""

import sys
from pathlib import Path

# examples.rivals for Python, rivals for pytest: the neighbours are the same either way
_EXAMPLES = str(Path(__file__).resolve().parents[1])
if _EXAMPLES not in sys.path:
    sys.path.insert(0, _EXAMPLES)
