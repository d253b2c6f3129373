"""`python -m rkfbench` is the command `rkfbench`."""

from rkfbench.cli import main

if __name__ == "__main__":
    main()
