"""``python -m hybridsurrogate`` is the command line."""

from hybridsurrogate.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
