"""The command `pirrht`; modules that take long to import are imported once the words are known to be good."""

from collections.abc import Sequence

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command, of the words `argv` or those that this process was started with.

    Returns:
        0 for success, 1 for a run that failed, 2 for bad input, 128 + n if signal n ended it (130: Ctrl-C).
    """
    if argv is None:  # until there is something to clean up Ctrl-C just ends the process, as the system does it
        import _signal  # type: ignore[import-not-found]  # the built-in part of `signal`, there from the start

        if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:
            _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    from sim import extras
    from sim.cli import ending

    def command() -> int:
        from sim.cli import parser

        arguments = parser.read(argv)
        extras.require(f"pirrht {arguments.command}", "sim", *parser.extras_of(arguments))
        parser.check_outputs(arguments)
        from sim.cli import commands

        with ending.unwinding():
            return commands.COMMANDS[arguments.command](arguments)

    return ending.ended(command, process=argv is None)
