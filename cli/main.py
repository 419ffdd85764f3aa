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
    "reconstruct": "From a video or photographs to mesh, volume, centre of mass and inertia.",
    "estimate": "Motion and inertia ratios from tracks, attitudes or body rates.",
    "crosscheck": "Does the way the body moves agree with the mesh's inertia?",
    "diagnose": "Find the effect that is missing in the model of a motion.",
    "effects": "List the known effects, with formulas and parameters.",
    "compare": "Compare a run or a mesh with a CAD mesh.",
    "mass": "Mass properties of a finished mesh.",
    "export": "Write files for simulators, filters and other programs.",
    "simulate": "Make test data with known truth.",
    "campaign": "Run many cases, on this machine or a cluster.",
    "reproduce": "Repeat the tables of five papers, our numbers beside theirs.",
    "masks": "Look at a run's silhouettes, correct them, give them back.",
    "view": "Open a report, a list of runs, or a comparison in the browser.",
    "doctor": "Check the installation.",
    "completion": "Print a script for completion in your shell.",
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

    def invoke(self, ctx: Any) -> Any:
        """Nothing is asked at the terminal: the end of a file is no interrupt, for which typer takes it."""
        try:
            return super().invoke(ctx)
        except EOFError as error:
            raise RuntimeError(f"end of file: {error}") from error

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name]) for name in self.list_commands(ctx)])


def no_command(name: str) -> str:
    """What to say to a command that there is none of, with the nearest that there is."""
    from difflib import get_close_matches

    near = get_close_matches(name, COMMANDS, 2, 0.6)
    return f"no such command: {name}" + (f"; did you mean {' or '.join(near)}?" if near else "")


def _exists(name: str) -> bool:
    from importlib.util import find_spec

    return find_spec(f"massprops_cli.{name}") is not None


def load(name: str) -> Any:
    """The click command of one file."""
    function = import_module(f"massprops_cli.{name}").command
    single = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    single.command(name, context_settings=HELP_NAMES)(function)
    command: Any = typer.main.get_command(single)
    command.name = name
    for param in command.params:
        _show_as_written(param)
    return command


def _show_as_written(param: Any) -> None:
    """Names an argument by its metavar alone, and a repeated option's type without Python's `list[...]`.

    Versions of typer differ in the brackets, braces and types that they add.
    """
    record = param.get_help_record
    if param.param_type_name == "argument":
        param.get_usage_pieces = lambda ctx: [param.metavar]

    def shown(ctx: Any) -> tuple[str, str] | None:
        name_and_help = record(ctx)
        if name_and_help is None:
            return None
        if param.param_type_name == "argument":
            return param.metavar.translate(str.maketrans("", "", "[]")), name_and_help[1]
        return name_and_help[0].replace("<list[", "<").replace("]>", ">"), name_and_help[1]

    param.get_help_record = shown


def app() -> Any:
    """The whole command group."""
    group = typer.Typer(
        cls=Lazy,
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings=HELP_NAMES,
        help="Measure the mass properties of an object from a video of it, and from the way it moves.",
        epilog="'massprops COMMAND -h' shows the options of a command. With -v, every command logs what it does; with -vv "
        "in detail. Example: massprops reconstruct video.mp4 -o runs/one --scale 0.42",
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
        if not error.errno and _out_of_address_space(error):
            return 3
        _say(f"{error.filename or 'output'}: {error.strerror or error}{PLACES.get(error.errno or 0, '')}")
        return 2
    except MemoryError as error:
        if not _out_of_address_space(error):
            _say("not enough memory for this input: give a smaller one")
        return 3
    except Exception as error:
        if isinstance(error, ImportError) and _out_of_address_space(error):
            return 3
        _say(
            f"unexpected {type(error).__name__}: {_first_line(error)}: this is a bug in massprops; {_report(arguments)}"
        )
        if os.environ.get("MASSPROPS_DEBUG"):
            raise
        return 3


def _out_of_address_space(error: Exception) -> bool:
    """Where address space is limited, says so: libraries that cannot be loaded then have many words for it."""
    from massprops.core.processes import address_space_hint

    hint = address_space_hint()
    if hint:
        _say(f"{_first_line(error) or 'not enough memory'}{hint}")
    return bool(hint)


def _check_text(argument: str) -> None:
    """Refuses a name that is no UTF-8: native libraries cannot open it, and some crash over it.

    So is an empty one, which would stand for the current folder.
    """
    if not argument:
        raise InputError("an argument is empty, as of a variable of the shell that is not set")
    try:
        argument.encode()
    except UnicodeEncodeError:
        raise InputError(f"{argument}: the name is not UTF-8; rename it") from None


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
        return "please report it in the project's issue tracker, with the output under MASSPROPS_DEBUG=1"
    return f"please report it in the project's issue tracker, with the file {name}"


def _after_interrupt(arguments: list[str]) -> str:
    command, kept = arguments[0], any(a.startswith(("-o", "--out")) for a in arguments)
    if kept and command in ("reconstruct", "campaign", "reproduce") and "--only" not in arguments:
        return "give the same command again to continue"
    return "the same command will start from the beginning" + (
        " (with -o FOLDER it continues)" if command == "reproduce" else ""
    )


def _say(text: str) -> None:
    tell("massprops: " + " ".join(text.split()))


if __name__ == "__main__":
    main()
