"""Extras of the package: the modules that each installs, and one offer of all that a task lacks."""

from importlib.util import find_spec

from pirrht.errors import OptionError

EXTRAS = {
    "sim": ("defusedxml", "mujoco", "pyarrow", "rerun", "tqdm"),
    "figures": ("matplotlib",),
    "video": ("av", "PIL", "OpenGL"),
    "maps": ("yaml", "PIL"),
    "gym": ("gymnasium",),
    "cluster": ("distributed",),
    "decompose": ("coacd",),
    "ros": ("cyclonedds", "mcap", "rosbags"),
}
MAPS = (".yaml", ".yml")
BAGS = (".mcap", ".bag", ".db3")
BY_ENDING = {**dict.fromkeys(MAPS, "maps"), **dict.fromkeys(BAGS, "ros")}  # extras that read or write such files


def require(what: str, *extras: str) -> None:
    """Refuse a task by OptionError if modules of its extras are missing; the message installs all of them at once."""
    lacking = {extra: [name for name in EXTRAS[extra] if find_spec(name) is None] for extra in dict.fromkeys(extras)}
    lacking = {extra: names for extra, names in lacking.items() if names}
    if lacking:
        modules = ", ".join(dict.fromkeys(name for names in lacking.values() for name in names))
        install = f"pip install 'pirrht[{','.join(lacking)}]'"
        raise OptionError(f"{what} needs {modules}; install with: {install}, or 'pirrht[all]' for every command")
