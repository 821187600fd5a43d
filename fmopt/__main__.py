"""`python -m fmopt`, and the command `fmopt`: signals are answered before anything heavy is loaded."""

from typing import NoReturn

from fmopt.runtime.process import run


def main() -> NoReturn:
    """Runs the command line."""
    run(_command)


def _command() -> int:
    from fmopt.cli.entry import command

    return command()


if __name__ == "__main__":
    main()
