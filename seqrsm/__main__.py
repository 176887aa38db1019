"""The command ``seqrsm``, also as ``python -m seqrsm``."""

import os
import signal
import sys


def main() -> None:
    """Entry point of the console script."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # while the command is loaded Ctrl-C ends it without a traceback
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # closed, as by `>&-`: else the next file, such as the store, takes its place
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115
    from seqrsm.cli.app import main as command

    command()


if __name__ == "__main__":
    main()
