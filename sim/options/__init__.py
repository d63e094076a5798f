"""Every option of the command line and of scenes, once: what it may be, whom it belongs to and what it decides.

record    one option: its values and their bounds, and what is refused
settings  those of a run: problem, planner and sampler, methods, drive
commands  those of one command: scenes and robots, files, recordings, sweeps, what is imported and exported
table     all of them, and questions about them

The parser, the numerics that a scene may carry, the checks, the help, `docs/cli.md` and what identifies the dataset of
a sweep all follow from it.
"""
