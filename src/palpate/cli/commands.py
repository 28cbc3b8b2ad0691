"""The application: its commands, and its exit codes for errors."""

from __future__ import annotations

import errno
import logging
import os
import signal
import sys
import warnings
from typing import Annotated, Any

import typer

import palpate
from palpate.cli.bench import bench_app
from palpate.cli.calibrate import calibrate
from palpate.cli.command import Command
from palpate.cli.convert import convert
from palpate.cli.demo import demo
from palpate.cli.design import design
from palpate.cli.examples import SHORT, example
from palpate.cli.files import sole_writers
from palpate.cli.film import film
from palpate.cli.identify import identify
from palpate.cli.live import live
from palpate.cli.methods import MethodCommand, TrackerCommand
from palpate.cli.pad import pad
from palpate.cli.paper import paper
from palpate.cli.pillars import pillars
from palpate.cli.reconstruct import reconstruct
from palpate.cli.ros import RosCommand, ros
from palpate.cli.sensors import sensors
from palpate.cli.simulate import simulate
from palpate.cli.terminal import guarded
from palpate.cli.tfm import tfm
from palpate.cli.track import track
from palpate.cli.weigh import weigh
from palpate.errors import PalpateError, printable

app = typer.Typer(
    name="palpate",
    help="What touches an elastic pad: surface pressure and shear from stress, strain or displacement measured inside it.",
    epilog="\b\nStart with:\n  palpate demo\n  palpate reconstruct palpate-demo/recording.nc --skin palpate-demo/skin.toml --plot touch.png\nEvery command says more with --help.",
    invoke_without_command=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(value: bool) -> None:
    if value:
        typer.echo(f"palpate {palpate.__version__}")
        raise typer.Exit


@app.callback()
def _root(
    ctx: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    ctx.with_resource(guarded())
    ctx.with_resource(sole_writers())
    # palpate reports damaged files itself, with a clear message
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())


#: Commands that take the options of methods, with their classes.
_TAKING = {track: TrackerCommand, live: TrackerCommand, ros: RosCommand, reconstruct: MethodCommand}
_COMMANDS = (
    demo,
    reconstruct,
    track,
    live,
    tfm,
    film,
    pillars,
    ros,
    convert,
    simulate,
    pad,
    design,
    sensors,
    identify,
    weigh,
    calibrate,
    paper,
)
for _command in _COMMANDS:
    app.command(
        cls=_TAKING.get(_command, Command), short_help=SHORT[_command.__name__], epilog=example(_command.__name__)
    )(_command)
app.add_typer(bench_app, name="bench")


#: Errors of a full or read-only disk, which are not mistakes of the caller.
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


def main() -> None:
    """Entry point; prints an error as one line on stderr.

    The exit code is 2 for a request that cannot be met, 1 for a failure of the system (such as a full disk), and 128
    plus the signal for a stopped command: 130 after Ctrl-C, 143 after SIGTERM.
    """
    warnings.showwarning = _warned
    try:
        # raise, as Ctrl-C does, so that half-written files are removed
        signal.signal(signal.SIGTERM, _stop)
        code = app(standalone_mode=False, prog_name="palpate")
        if code == 130:  # typer's exit code for Ctrl-C
            raise KeyboardInterrupt
    except (typer.Abort, KeyboardInterrupt):
        _fail("stopped", 130)
    except _Stopped:
        _fail("stopped by SIGTERM", 143)
    except typer.TyperException as error:
        path = getattr(getattr(error, "ctx", None), "command_path", None) or "palpate"
        _fail(f"{error.format_message()} ({path} --help{' has examples' if ' ' in path else ''})", 2)
    except PalpateError as error:
        _fail(str(error), 1 if isinstance(error.__cause__, OSError) and error.__cause__.errno in _DISK else 2)
    except MemoryError as error:
        _fail(_out_of_memory(error), 1)
    except OSError as error:
        _fail(f"{error.filename or 'file'}: {error.strerror or error}", 1)
    sys.exit(code if isinstance(code, int) else 0)


#: Advice on how to use less memory, by the part of palpate that ran out of it.
_COARSER = "Give a coarser surface ([surface] with a larger spacing in the skin.toml), or fewer taxels."
_SHORTER = "Cut the file into shorter ones."
_VERBOSITY = {
    **dict.fromkeys(("sensing", "inverse", "uncertainty", "tracking"), _COARSER),
    **dict.fromkeys(("recordings", "network"), _SHORTER),
    "archives": "Take fewer frames at a time: --chunk 16 --workers 1.",
    "camera": "Give fewer or smaller pictures.",
    "calibrate": "Give fewer labels: --labels 100.",
    "microscopy": "Give a smaller part of the picture.",
    "_plot": "Leave the picture out.",
}


def _out_of_memory(error: MemoryError) -> str:
    """Return what needed too much memory, and what to do. The innermost module of palpate in the traceback decides,
    because a long file and a fine surface need different advice.
    """
    advice, at = "Close other programs, or give fewer frames or pictures at a time.", error.__traceback__
    rooms = set()
    while at is not None:
        _, _, inside = at.tb_frame.f_globals.get("__name__", "").partition("palpate.")
        rooms.add(inside.split(".")[0])
        advice = _VERBOSITY.get(inside.split(".")[0], advice)
        at = at.tb_next
    if "microscopy" in rooms and advice == _COARSER:  # no skin.toml describes the surface of a cell's gel
        advice = _VERBOSITY["microscopy"]
    what = str(error).strip().rstrip(".")
    return f"not enough memory{f' ({what})' if what else ''}. {advice}"


def _warned(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: Any = None,
    line: str | None = None,
) -> None:
    """Print a warning as one line, without the place in the code that it comes from."""
    sys.stderr.write(f"warning: {' '.join(printable(str(message)).split())}\n")


class _Stopped(BaseException):
    """Raised when the process receives SIGTERM."""


def _stop(*_: object) -> None:
    raise _Stopped


def _fail(message: str, code: int) -> None:
    sys.stderr.write(f"error: {' '.join(printable(message).split())}\n")
    sys.exit(code)
