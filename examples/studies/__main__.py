"""``python -m examples.studies NAME [...]`` runs one study; without a name it lists them."""

import runpy
import sys
from pathlib import Path

HERE = Path(__file__).parent
NAMES = sorted(
    path.stem
    for path in HERE.iterdir()
    if (path / "__main__.py").exists() or "__main__" in path.name or path.suffix == ".py"
    if not path.stem.startswith("_") and not path.stem.endswith(("_sets", "_simulations"))
)


def main() -> None:
    """Run the study that the first argument names."""
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        sys.exit("\n".join(["python -m examples.studies NAME, with one of:", *NAMES]))
    sys.argv = sys.argv[1:]
    # studies import their neighbours by name
    sys.path.insert(0, str(HERE))
    runpy.run_module(f"examples.studies.{sys.argv[0]}", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
