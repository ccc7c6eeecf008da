"""``python -m hybridsurrogate`` is the command line."""

from hybridsurrogate.cli import main

raise SystemExit(main())
