"""The diagnosis next to other tools on the same blind cases: `python -m examples.alternatives`."""

import sys
from pathlib import Path

# examples.alternatives for Python, alternatives for pytest: the neighbours are the same either way
_EXAMPLES = str(Path(__file__).resolve().parents[1])
if _EXAMPLES not in sys.path:
    sys.path.insert(0, _EXAMPLES)
