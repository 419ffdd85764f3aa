"""Options of the commands: names, defaults and help come from the functions of the package, which have the same."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from functools import wraps
from types import SimpleNamespace
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

Given = TypeVar("Given")

FORCE = "Replace files in the output folder that massprops did not write. Inputs are never replaced."
Force = Annotated[bool, typer.Option("--force", help=FORCE)]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Do not show progress.")]


def takes(options: Callable[..., Given]) -> Callable[[Callable[[Given], Any]], Callable[..., Any]]:
    """Makes a function of one dataclass the command whose arguments and options are the dataclass's fields."""

    def command_of(function: Callable[[Given], Any]) -> Callable[..., Any]:
        @wraps(function)
        def command(**given: Any) -> Any:
            return function(options(**given))

        types = get_type_hints(options, include_extras=True)
        parameters = inspect.signature(options).parameters.values()
        command.__annotations__ = types
        command.__signature__ = inspect.Signature([p.replace(annotation=types[p.name]) for p in parameters])  # type: ignore[attr-defined]
        return command

    return command_of


def defaults(verb: Callable[..., Any]) -> SimpleNamespace:
    """The default of every option of a function, by its name; of several values None, as the command line has it."""
    given = {name: p.default for name, p in inspect.signature(verb).parameters.items()}
    return SimpleNamespace(**{name: None if value == () else value for name, value in given.items()})


def option(verb: Callable[..., Any], name: str, *flags: str, **more: Any) -> Any:
    """The option of the function's parameter `name`, with what its docstring says of it as the help."""
    return typer.Option(*(flags or (f"--{name.replace('_', '-')}",)), help=help_of(verb, name), **more)


def as_json(what: str) -> Any:
    """The option that prints a document in place of a table."""
    return typer.Option("--json", help=f"Print {what} to stdout and nothing else.")


def argument(verb: Callable[..., Any], name: str, metavar: str) -> Any:
    """The argument of the function's parameter `name`."""
    return typer.Argument(metavar=metavar, help=help_of(verb, name))


def help_of(verb: Callable[..., Any], name: str) -> str:
    """What the docstring's Args say of a parameter, as a sentence; what holds "In Python" is left out."""
    args = inspect.getdoc(verb).partition("\nArgs:\n")[2].partition("\n\n")[0]  # type: ignore[union-attr]
    explanation = re.search(rf"^    {name}: (.*(?:\n {{8}}.*)*)", args, re.M)
    assert explanation is not None, f"{verb.__name__}: its docstring does not explain {name}"
    text = " ".join(explanation[1].split()).partition(" In Python")[0]
    return text[:1].upper() + text[1:]
