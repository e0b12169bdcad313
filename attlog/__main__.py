"""``python -m attlog``: the same as the command ``attlog``."""

from attlog.cli import main

if __name__ == "__main__":
    main()
