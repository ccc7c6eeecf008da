"""How good the diagnosis is: `python -m examples.studies.scorecard`."""

import sys
from pathlib import Path

# for Python and pytest alike the neighbours go by their plain names
_STUDIES = str(Path(__file__).resolve().parents[1])
if _STUDIES not in sys.path:
    sys.path.insert(0, _STUDIES)
