"""``python -m seqrsm`` is the command ``seqrsm``."""

from seqrsm.cli.app import main

if __name__ == "__main__":
    main()
