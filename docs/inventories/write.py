"""Write the inventories of other projects that pages link to: `python docs/inventories/write.py`.

They hold only the names in use, so that pages build without a network.
"""

import zlib
from pathlib import Path

NAMES = {
    "scipy": ["scipy.integrate.solve_ivp py:function 1 reference/generated/$.html#$ -"],
    "sklearn": [
        "sklearn.model_selection.GridSearchCV py:class 1 modules/generated/$.html#$ -",
        "sklearn.model_selection.GroupKFold py:class 1 modules/generated/$.html#$ -",
    ],
}

for project, lines in NAMES.items():
    head = f"# Sphinx inventory version 2\n# Project: {project}\n# Version: \n"
    head += "# The remainder of this file is compressed using zlib.\n"
    body = zlib.compress("".join(f"{line}\n" for line in lines).encode())
    Path(__file__).with_name(f"{project}.inv").write_bytes(head.encode() + body)
