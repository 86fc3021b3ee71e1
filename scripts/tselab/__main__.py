"""Entry point of the command `tselab`."""

import sys


def main() -> None:
    """Run the command. If it needs a Python package that is not installed, print the name
    of the package and exit with code 2."""
    try:
        from tselab.cli import main as command
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("tse"):
            raise
        print(f"tselab: the Python package {error.name} is needed: pip install 'tse[lab]'", file=sys.stderr)
        sys.exit(2)
    command()


if __name__ == "__main__":
    main()
