"""Parsers of the command line whose errors are one line with a hint."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from isosample.errors import InputError
from isosample.wording import probably_meant

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Commands = argparse._SubParsersAction["CommandParser"]

LONG_OPTION = re.compile(r"--[a-z][a-z-]*")
NEGATIVE_VALUE = re.compile(r"-[0-9.]")


class CommandParser(argparse.ArgumentParser):
    """An argument parser that raises `InputError`, keeps the epilog's lines and takes no abbreviations.

    Attributes
    ----------
    late_list : str
        Positional list of paths, whose words may stand behind options too, though `argparse` ends such a list at the
        first option; empty for none.
    """

    late_list = ""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False, **options)
        self.add_argument(
            "--debug",
            action="store_true",
            default=argparse.SUPPRESS,
            help="show the traceback of an error",
        )

    def error(self, message: str) -> NoReturn:
        """Raise `message` with a hint where the options are explained."""
        raise InputError(f"{message.rstrip('.')}; see `{self.prog} --help`")

    def option_names(self) -> list[str]:
        """Return every option that the parser knows."""
        return [name for action in self._actions for name in action.option_strings]


def add_command(
    commands: Commands,
    name: str,
    run: Callable[[argparse.Namespace], int],
    *,
    summary: str,
    example: str,
) -> CommandParser:
    """Return the parser of a new command.

    Parameters
    ----------
    commands : result of `add_subparsers`
    name : str
    run : callable
        Does the command with the parsed arguments, and returns the exit status.
    summary : str
        One sentence.
    example : str
        Command lines, one per line.
    """
    lines = "\n".join(f"  {line}" for line in example.splitlines())
    parser = commands.add_parser(name, help=summary, description=summary, epilog=f"example:\n{lines}")
    parser.set_defaults(run=run, parser=parser)
    return parser


def parse_arguments(parser: CommandParser, arguments: Sequence[str]) -> argparse.Namespace:
    """Parse all arguments; an unknown one is named together with the option that was probably meant."""
    options, unknown = parser.parse_known_args(arguments)
    command: CommandParser = options.parser
    if command.late_list and not any(word.startswith("-") for word in unknown):
        setattr(options, command.late_list, [*getattr(options, command.late_list), *map(Path, unknown)])
        unknown = []
    if unknown:
        written = unknown[0].partition("=")[0]
        near = probably_meant(written, command.option_names()) if written.startswith("-") else None
        meant = f" (did you mean {near}?)" if near else ""
        command.error(f"unexpected argument {unknown[0]!r}{meant}")
    return options


def join_negative_values(arguments: Sequence[str]) -> list[str]:
    """Write ``--clip -1,0,0,5`` as ``--clip=-1,0,0,5``: the parser takes only the latter for a value."""
    joined: list[str] = []
    for number, argument in enumerate(arguments):
        if argument == "--":
            return [*joined, *arguments[number:]]
        if joined and NEGATIVE_VALUE.match(argument) and LONG_OPTION.fullmatch(joined[-1]):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined
