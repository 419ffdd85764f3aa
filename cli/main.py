"""The command `massprops`: finds the command's file and turns errors into one line and an exit code."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import typer
import typer.core

from massprops.errors import InputError, MasspropsError
from massprops_cli.log import start_log, verbosity
from massprops_cli.terminal import tell

COMMANDS = {
    "reconstruct": "From footage to mesh, volume, centre of mass and inertia.",
    "estimate": "Motion and inertia ratios from tracks, attitudes or body rates.",
    "crosscheck": "The mesh's inertia against every estimator on the same sequence.",
    "diagnose": "Where simulation and measurement disagree, and which effect is missing.",
    "effects": "The effects that can act, with parameters, needs and formula.",
    "compare": "A run or mesh against a CAD mesh.",
    "mass": "Mass properties, report and exports from a finished mesh.",
    "export": "Files for a simulator, a filter, or programs that read cameras.",
    "simulate": "A tumbling body with known truth, rendered or tracked.",
    "campaign": "Many runs, on this machine or a cluster.",
    "reproduce": "The tables of the five papers, ours beside theirs.",
    "masks": "A run's silhouettes over its images, to mend and give back.",
    "view": "The report in the browser.",
    "doctor": "What is installed, what is missing, and what to type.",
    "completion": "A script that lets your shell complete commands and options.",
}


HELP_NAMES = {"help_option_names": ["-h", "--help"]}

USAGE: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")
"""What typer raises for a command line it cannot read, whichever click it carries."""


PLACES = dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), ": free some space or choose another place")
PLACES |= dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS), ": no permission there; choose another place")
"""What to do about a place that cannot be written or read."""


class Lazy(typer.core.TyperGroup):
    """Imports a command's file only when that command is called, so that `--help` answers at once."""

    def list_commands(self, ctx: Any) -> list[str]:
        return [name for name in COMMANDS if _exists(name)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in COMMANDS or not _exists(cmd_name):
            return None
        return load(cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args and args[0] not in COMMANDS and not args[0].startswith("-") and not ctx.resilient_parsing:
            ctx.fail(no_command(args[0]))
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name]) for name in self.list_commands(ctx)])


def no_command(name: str) -> str:
    """What to say to a command that there is none of, with the nearest that there is."""
    from difflib import get_close_matches

    near = get_close_matches(name, COMMANDS, 2, 0.6)
    return f"No such command '{name}'" + (f": did you mean {' or '.join(near)}?" if near else ".")


def _exists(name: str) -> bool:
    from importlib.util import find_spec

    return find_spec(f"massprops_cli.{name}") is not None


def load(name: str) -> Any:
    """The click command of one file."""
    function = import_module(f"massprops_cli.{name}").command
    single = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    single.command(name, context_settings=HELP_NAMES)(function)
    command = typer.main.get_command(single)
    command.name = name
    return command


def app() -> Any:
    """The whole command group."""
    group = typer.Typer(
        cls=Lazy,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings=HELP_NAMES,
        help="Mass properties of an object from a video of it, and from the way it moves.",
        epilog="Every command: -h shows its options; -v says what is done, -vv also what the libraries say. "
        "Example: massprops reconstruct video.mp4 -o runs/one --scale 0.42",
    )

    @group.callback(invoke_without_command=True)
    def base(
        ctx: typer.Context,
        version: bool = typer.Option(False, "--version", help="Print the version."),
    ) -> None:
        if version:
            import massprops

            typer.echo(f"massprops {massprops.__version__}")
            raise typer.Exit
        if ctx.invoked_subcommand is None:
            typer.echo(ctx.get_help())
            raise typer.Exit

    return typer.main.get_command(group)


def main() -> None:
    """Entry point: exit codes 0 done, 2 wrong input, 3 in part, 130 interrupted."""
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    for stream in (sys.stdout, sys.stderr):  # a terminal of another encoding shows a code for what it cannot show
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")
    sys.exit(run(sys.argv[1:]))


COMPLETE = "_MASSPROPS_COMPLETE"
"""Set by the script of `massprops completion`."""
QUIET = {
    # small matrices throughout: a second BLAS thread only spins; large stages set their own threads
    "OPENBLAS_NUM_THREADS": "1",
    # native libraries write their warnings past Python
    "OPENCV_LOG_LEVEL": "SILENT",
    "GLOG_minloglevel": "3",
    # for what is started from here: the current folder holds the user's files, not modules
    "PYTHONSAFEPATH": "1",
}


def run(arguments: list[str]) -> int:
    """Runs one command line; never a traceback, and no word of a library's."""
    level, arguments = verbosity(arguments)
    start_log(level)
    with contextlib.nullcontext() if level > 1 else _libraries_silent():
        return _run(arguments)


@contextlib.contextmanager
def _libraries_silent() -> Iterator[None]:
    """Keeps the warnings and logs of libraries from the terminal; `MASSPROPS_DEBUG=1` shows them."""
    if os.environ.get("MASSPROPS_DEBUG"):
        yield
        return
    import logging
    import warnings

    last = logging.lastResort
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        logging.lastResort = None
        try:
            yield
        finally:
            logging.lastResort = last


def _run(arguments: list[str]) -> int:
    try:
        for argument in arguments:
            _check_text(argument)
        if os.environ.get(COMPLETE):
            from typer.completion import completion_init  # type: ignore[attr-defined]

            completion_init()
        status = app().main(args=arguments, prog_name="massprops", standalone_mode=False)
        if status == 130:  # typer's own word for an interrupt
            raise KeyboardInterrupt
        return int(status) if isinstance(status, int) else 0
    except MasspropsError as error:
        _say(str(error))
        return error.exit_code
    except typer.Exit as stop:
        return stop.exit_code
    except (typer.Abort, KeyboardInterrupt):
        _say(f"interrupted: {_after_interrupt(arguments)}")
        return 130
    except USAGE as error:
        hint = getattr(error, "ctx", None)
        _say(error.format_message() + (f" (see '{hint.command_path} --help')" if hint else ""))
        return 2
    except BrokenPipeError:
        return 0
    except OSError as error:
        _say(f"{error.filename or 'output'}: {error.strerror or error}{PLACES.get(error.errno or 0, '')}")
        return 2
    except MemoryError:
        _say("not enough memory for this input: give a smaller one")
        return 3
    except Exception as error:
        _say(
            f"unexpected {type(error).__name__}: {_first_line(error)}: this is a bug of massprops; {_report(arguments)}"
        )
        if os.environ.get("MASSPROPS_DEBUG"):
            raise
        return 3


def _check_text(argument: str) -> None:
    """Refuses a name that is no UTF-8: native libraries cannot open it, and some crash over it."""
    try:
        argument.encode()
    except UnicodeEncodeError:
        raise InputError(f"{argument}: the name is not UTF-8: rename it") from None


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [""])[0][:200]


def _report(arguments: list[str]) -> str:
    """Writes what a developer needs into a file; what to do with it."""
    import platform
    import tempfile
    import traceback

    import massprops

    head = f"massprops {massprops.__version__}, Python {platform.python_version()}, {platform.platform()}\n{arguments!r}\n\n"
    try:
        handle, name = tempfile.mkstemp(prefix="massprops-", suffix=".txt", text=True)
        with os.fdopen(handle, "w", errors="backslashreplace") as file:
            file.write(head + traceback.format_exc())
    except OSError:
        return "please report it in the project's issue tracker, with what MASSPROPS_DEBUG=1 shows"
    return f"please report it in the project's issue tracker, with the file {name}"


def _after_interrupt(arguments: list[str]) -> str:
    command, kept = arguments[0], any(a.startswith(("-o", "--out")) for a in arguments)
    if kept and command in ("reconstruct", "campaign", "reproduce") and "--only" not in arguments:
        return "the same command continues where it stood"
    return "the same command begins anew" + (" (with -o FOLDER it would continue)" if command == "reproduce" else "")


def _say(text: str) -> None:
    tell("massprops: " + " ".join(text.split()))


if __name__ == "__main__":
    main()
