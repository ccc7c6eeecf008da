"""The reference page of the command line, from the same table as its parsers."""

from __future__ import annotations

from collections.abc import Iterator

from hybridsurrogate.command_line.commands import COMMANDS, Subcommand
from hybridsurrogate.command_line.main import EXIT_CODES
from hybridsurrogate.command_line.options import Option

_HEAD = f"""# Command line

`hybridsurrogate COMMAND --help` prints what stands here.

{EXIT_CODES}

A study file contains options in TOML: `--config study.toml`. Its keys are the options with `_` for
`-`. Files in it are relative to its folder. What is typed takes precedence.

```toml
measured = "measured.csv"
simulation = "decay.py:decay"
inputs = ["minutes"]
output = "glucose"

[prior]
rate = [0.2, 0.05]

[units]
minutes = "min"
```
"""


def reference_page() -> str:
    """Return the page as Markdown; ``docs/reference/command-line.md`` contains it.

    Examples
    --------
    >>> reference_page().splitlines()[0]
    '# Command line'
    """
    return "\n".join([_HEAD, *(line for command in COMMANDS for line in _section(command))])


def _section(command: Subcommand) -> Iterator[str]:
    yield f"## {command.name}\n\n{command.description}\n"
    yield f"```console\n$ {command.example}\n```\n"
    yield "| option | meaning | default |\n|---|---|---|"
    for option in command.options:
        choices = f": {', '.join(option.allowed)}" if option.choices else ""
        again = "; may be repeated" if option.kind == "pairs" else ""
        meaning = f"{option.meaning}{choices}{again}".replace("|", "\\|")
        default = f"`{option.shown_default}`" if option.shown_default else ""
        yield f"| {_written(option)} | {meaning} | {'required' if option.required else default} |"
    yield ""


def _written(option: Option) -> str:
    if option.positional:
        return f"`{option.metavar}`"
    if option.kind == "yes":
        return f"`{option.flag}`"
    value = option.metavar or option.name.upper()
    several = " ..." if option.kind in ("names", "numbers", "paths") else ""
    return f"`{option.flag} {value}{several}`"


if __name__ == "__main__":
    # python -m hybridsurrogate.command_line.reference > docs/reference/command-line.md
    print(reference_page(), end="")
