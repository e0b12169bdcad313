"""``python -m attlog`` and the command ``attlog``."""

import signal


def main() -> None:
    """Run the command. An interrupt while it is still being imported ends it without a traceback."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from attlog.cli import main as run

    run()


if __name__ == "__main__":
    main()
