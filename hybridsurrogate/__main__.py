"""``python -m hybridsurrogate`` is the command line."""

from hybridsurrogate.command_line.main import main

if __name__ == "__main__":
    raise SystemExit(main())
