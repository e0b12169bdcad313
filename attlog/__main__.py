"""``python -m attlog`` and the command ``attlog``."""

import sys
from pathlib import Path

# Before anything that an older Python lacks. This file and attlog/__init__.py are read by any Python 3.
if sys.version_info < (3, 11):  # noqa: UP036
    sys.stderr.write("attlog needs Python 3.11 or newer, this is %d.%d\n" % sys.version_info[:2])  # noqa: UP031
    sys.exit(2)

if __name__ == "__main__" and not sys.flags.safe_path:
    # ``-m`` puts the current folder first, where a file beside a log may be called numpy.py; the command does not.
    if not Path(sys.path[0], "attlog", "__init__.py").is_file():
        del sys.path[0]

import os
import signal


def main() -> None:
    """Run the command. An interrupt while it is still being imported ends it without a traceback."""
    if not os.path.isdir(os.path.dirname(__file__)):  # templates, scenarios and machine code are read as files
        print("attlog: does not run out of a zip file: install it (pip install), or unpack it", file=sys.stderr)
        raise SystemExit(2)
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from attlog.cli import main as run

    run()


def command() -> None:
    """Run the command and end the process at once, unless a profiler, debugger or other program started it."""
    own = ["-m", "attlog"] if __name__ == "__main__" else sys.argv[:1]
    if sys.orig_argv[1:] != own + sys.argv[1:]:
        return main()
    try:
        main()
    except SystemExit as stop:
        from attlog.cli.process import end

        end(stop.code)


if __name__ == "__main__":
    command()
