"""The command ``seqrsm``, also as ``python -m seqrsm``."""

import signal


def main() -> None:
    """Entry point of the console script."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # while the command is loaded Ctrl-C ends it without a traceback
    from seqrsm.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
