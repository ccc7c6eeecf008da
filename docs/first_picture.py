"""Draw the picture of the start page from its code: `python docs/first_picture.py`."""

from pathlib import Path

import matplotlib
import outputs

matplotlib.use("Agg")
matplotlib.rcParams.update({"svg.hashsalt": "hybridsurrogate", "savefig.facecolor": "white"})
names: dict = {}
for block in outputs.blocks(outputs.DOCS / "index.md"):
    exec(block.code, names)
axes = names["diagnosis"].plot(units={"temperature": "°C", "minutes": "min"})
path = Path(outputs.DOCS, "_static", "first_picture.svg")
axes[0].figure.savefig(path, metadata={"Date": None})
