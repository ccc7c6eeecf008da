"""The diagnosis next to other tools on blind cases: `python -m examples.studies.alternatives`."""

import sys
from pathlib import Path

# for Python and pytest alike the neighbours go by their plain names
_STUDIES = str(Path(__file__).resolve().parents[1])
if _STUDIES not in sys.path:
    sys.path.insert(0, _STUDIES)
